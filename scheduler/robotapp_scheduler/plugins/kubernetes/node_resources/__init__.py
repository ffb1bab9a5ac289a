"""Plugins about what a node offers and a pod requests."""
