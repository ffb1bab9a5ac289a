"""Leader election and events, as client-go's tools have them."""
