"""Input and output of the agent: sockets, files of the host, the API server."""
