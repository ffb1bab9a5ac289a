"""The importer of compose files: text in, Kubernetes objects and a report out."""
