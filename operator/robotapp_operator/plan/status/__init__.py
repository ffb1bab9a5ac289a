"""From facts to conditions, status and events."""
