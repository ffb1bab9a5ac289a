"""Base classes of the structs that are decoded from the API server's bytes (`gc=False`: the collector would walk 50,000 pods)."""

import msgspec


class Slim(msgspec.Struct, rename="camel", gc=False, kw_only=True, omit_defaults=True):
    """Base of all decoded structs: camelCase on the wire, unknown fields skipped."""


class SlimValue(msgspec.Struct, rename="camel", gc=False, kw_only=True, omit_defaults=True, frozen=True):
    """The same for values that serve as keys: hashable."""
