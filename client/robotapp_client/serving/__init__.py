"""Serves a component's HTTPS ports to those who may see them.

An import from here loads the whole client, because `robotapp_client` re-exports the names that most programs need.
"""
