"""Compose files as they are written: variables, values with their places, merging, one project."""
