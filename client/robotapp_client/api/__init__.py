"""The verbs of the API server, over the transport."""
