"""One attempt to place a pod or a group."""
