"""Places pods with ResourceClaims where their devices are, or can be allocated."""
