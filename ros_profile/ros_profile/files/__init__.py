"""Finding and reading files within bounds, and the cache. The only room with I/O."""
