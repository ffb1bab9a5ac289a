"""Nodes as columns."""
