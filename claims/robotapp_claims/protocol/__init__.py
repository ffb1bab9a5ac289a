"""The requests of the claim protocol stand in a room of their own, above the client they use."""
