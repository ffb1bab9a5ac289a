"""The scheduler's picture of the cluster, and the snapshot of it that plugins see."""
