"""The work queue and the kinds of work in it."""
