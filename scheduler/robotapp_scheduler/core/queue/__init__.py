"""Pods that wait for a node."""
