"""What one instance wants, read and checked."""
