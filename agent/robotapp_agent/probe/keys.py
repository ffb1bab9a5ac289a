"""The ring of keys that authenticate probes, and which of them signs while they are rotated. Pure."""


class KeyRing:
    """Starts empty: nothing is sent or answered until `update` brought a key."""
