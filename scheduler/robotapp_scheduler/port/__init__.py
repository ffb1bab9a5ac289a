"""The HTTPS port: a process of its own beside the one that places pods, and how the two talk."""
