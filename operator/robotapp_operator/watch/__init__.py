"""What the operator sees: kopf, informers, the cache they fill, and which keys a change adds."""
