"""What the scheduler reads of Kubernetes objects."""
