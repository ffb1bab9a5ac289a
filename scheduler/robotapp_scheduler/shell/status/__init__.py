"""What users read about a pod: conditions, events, messages."""
