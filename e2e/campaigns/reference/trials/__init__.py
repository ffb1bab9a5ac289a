"""Trials of the reference applications on real nodes: their work, and whether they keep what their READMEs promise through a fault."""
