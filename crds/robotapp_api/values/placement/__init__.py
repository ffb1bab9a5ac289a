"""Values that place components: tiers, neighbours, measured round trips, and the annotations about better nodes and fallbacks."""
