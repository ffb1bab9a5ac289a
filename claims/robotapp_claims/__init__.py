"""Claims of domains and devices: `rules` decides, `protocol` reads and writes the API server."""
