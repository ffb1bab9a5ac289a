"""The agent's process: its parts, their supervision, logs and the liveness check."""
