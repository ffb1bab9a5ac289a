"""Checks of recordings."""
