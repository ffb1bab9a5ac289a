"""Devices of a component: variables of its containers and its ResourceClaim."""
