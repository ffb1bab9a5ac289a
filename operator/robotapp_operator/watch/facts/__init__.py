"""The facts of one instance, read from the caches, from which its status is made."""
