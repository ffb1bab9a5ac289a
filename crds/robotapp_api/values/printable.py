"""Texts of others on a terminal."""


def printable(text: str, *, keep: str = "\n") -> str:
    """What others wrote, without what a terminal would obey: devices' names come from agents, messages from anywhere.

    keep: characters that stay although they are no letters.
    """
    kept = (each if each.isprintable() or each in keep else each.encode("unicode_escape").decode() for each in text)
    return "".join(kept)
