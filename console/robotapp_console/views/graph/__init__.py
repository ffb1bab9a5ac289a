"""The graph of an app: order of its boxes, their places and the lines between them, and what stands on them. Nothing is random."""
