"""What can change in a cluster, and the log of it."""
