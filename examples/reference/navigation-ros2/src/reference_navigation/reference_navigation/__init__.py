"""A robot with a lidar drives to its goal; its map and its path are made off board."""
