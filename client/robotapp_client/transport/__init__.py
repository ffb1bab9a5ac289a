"""Bytes to the API server and back: HTTP, TLS and logging in are the client's lowest room."""
