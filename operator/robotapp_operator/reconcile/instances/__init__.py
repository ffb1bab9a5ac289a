"""Reconciles one instance of an app: the plan by the caches, and the protocol that writes it."""
