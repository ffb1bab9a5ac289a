"""One handler per kind of work."""
