"""List and watch into a local copy."""
