"""The cache of the cluster's objects, and the snapshot of it that plugins get."""
