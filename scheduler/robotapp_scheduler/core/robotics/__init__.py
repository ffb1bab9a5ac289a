"""Apps, devices and round-trip times."""
