"""Sweeps: one instance of an app for each combination of the values of its matrix."""
