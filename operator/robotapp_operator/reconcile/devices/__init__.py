"""ResourceClaims of components: created and deleted, never changed."""
