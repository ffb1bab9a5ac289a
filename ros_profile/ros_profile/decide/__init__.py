"""Conclusions from what was read: units, closure of launch files, edges, classification. Pure.

`classify.classify(unit, *, curated: bool) -> Assessment` and `classify.aggregate(assessments) -> Assessment` are the
two functions the rest uses.
"""
