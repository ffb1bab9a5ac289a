"""Claims, volumes and classes, and which pods use them."""
