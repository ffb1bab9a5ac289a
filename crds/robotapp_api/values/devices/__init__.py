"""Devices: how people write them, and the variables that name them in a container."""
