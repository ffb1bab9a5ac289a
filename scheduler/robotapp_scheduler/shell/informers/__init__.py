"""Watch events into the cache and the queue."""
