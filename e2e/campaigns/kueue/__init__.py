"""Jobs of apps in a queue of kueue, with its real controller manager."""
