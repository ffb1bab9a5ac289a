"""Who holds which DDS domain and device: pure decisions, no I/O, no clock (see docs/claims.md for the protocol)."""
