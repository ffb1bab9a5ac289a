"""An operator drives a robot by velocity commands and measures every round trip."""
