"""Caches of a DRA driver's objects: ResourceSlices and ResourceClaims."""
