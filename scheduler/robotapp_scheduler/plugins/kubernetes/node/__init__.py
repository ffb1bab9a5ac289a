"""Plugins about the node itself: its name, taints, ports, images, features."""
