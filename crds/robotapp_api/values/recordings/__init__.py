"""Recordings as the components that they become."""
