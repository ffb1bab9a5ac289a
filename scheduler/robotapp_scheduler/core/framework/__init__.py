"""How a plugin is written, loaded and called."""
