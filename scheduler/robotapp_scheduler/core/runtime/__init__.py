"""A profile at work: filter and score results, cached and repaired row by row."""
