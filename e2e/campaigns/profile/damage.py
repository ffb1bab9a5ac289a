"""Damaged files: bytes that parsers dislike, put in, cut out, doubled or moved."""

import random

_BITS = (
    b"\0",
    b"\xff",
    b"\r",
    b"\t",
    b"'",
    b'"',
    b"(",
    b"]",
    b"{",
    b"&",
    b"*",
    b"<",
    b">",
    b"%",
    b"$(",
    b"\\ud800",
    b"\n",
    b": ",
    b"!!",
    b"\xef\xbb\xbf",
)


def mutated(data: bytes, chance: random.Random) -> bytes:
    """One to four changes: bytes put in, cut out, doubled, or a piece moved."""
    for _ in range(chance.randint(1, 4)):
        at, length = chance.randrange(len(data) + 1), chance.randint(0, 12)
        kind = chance.randrange(4)
        if kind == 0:
            data = data[:at] + chance.choice(_BITS) * chance.choice((1, 1, 2, 50)) + data[at:]
        elif kind == 1:
            data = data[:at] + data[at + length :]
        elif kind == 2:
            data = data[:at] + data[at : at + length] * chance.choice((2, 9)) + data[at + length :]
        else:
            other = chance.randrange(len(data) + 1)
            data = data[:at] + data[other : other + length] + data[at:]
    return data
