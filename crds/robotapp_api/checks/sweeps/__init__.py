"""Checks of sweeps."""
