"""Plugins about volumes."""
