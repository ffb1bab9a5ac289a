"""A coordinator gives tasks to three robots, each exactly once."""
