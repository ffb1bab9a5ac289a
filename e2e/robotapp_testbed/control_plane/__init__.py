"""The control plane: its servers, identities and API, and the product installed on it."""
