"""Reads from the API server: one set of informers per user."""
