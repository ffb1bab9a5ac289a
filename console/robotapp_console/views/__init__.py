"""Computes what each page shows from the API's objects, by pure functions."""
