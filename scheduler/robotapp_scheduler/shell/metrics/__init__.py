"""Metrics and how long plugins take."""
