"""Trials of the reference applications on real nodes: what each does, and whether it keeps what its README promises through a fault."""
