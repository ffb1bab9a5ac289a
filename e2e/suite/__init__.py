"""Chooses and runs the tests: which of them, in which order, on how many control planes at a time."""
