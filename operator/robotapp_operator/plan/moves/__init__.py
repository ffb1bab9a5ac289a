"""When a pod that runs is evicted so that it starts elsewhere, and the record of it."""
