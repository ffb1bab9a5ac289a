"""Components that end: the states of their Jobs, and the end of their instance."""
