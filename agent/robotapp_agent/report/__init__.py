"""What the agent writes and when: the status of NodeTelemetry from readings, changes that matter, load. Pure."""
