"""Nodes of a simulated cluster: their places, hardware, telemetry and network."""
