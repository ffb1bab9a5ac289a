"""Commands that work with a running app: its logs, its containers, its state."""
