"""From what is wanted to Kubernetes objects."""
