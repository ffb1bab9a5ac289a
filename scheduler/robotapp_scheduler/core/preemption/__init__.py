"""Selects the pods that are evicted for a pod that fits on no node."""
