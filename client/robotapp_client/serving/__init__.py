"""What a component of ours serves over HTTPS, and to whom."""
