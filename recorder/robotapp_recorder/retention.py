"""Chooses the bags to delete so that those of a recording stay within its bound. Pure."""

from collections.abc import Sequence
from typing import NamedTuple


class Bag(NamedTuple):
    """A bag on disk. Names begin with the time at which it was begun, so they sort by age."""

    name: str
    size_bytes: int


def choose_deleted(bags: Sequence[Bag], *, retain_bytes: int, split_bytes: int) -> list[Bag]:
    """Returns the oldest bags to delete before a bag is begun: the closed ones must leave room for a whole split.

    So all bags together are at most `retain_bytes`, and more only by as much as one bag exceeds its split.
    """
    room_bytes = max(0, retain_bytes - split_bytes)
    excess_bytes = sum(bag.size_bytes for bag in bags) - room_bytes
    deleted: list[Bag] = []
    for bag in sorted(bags):
        if excess_bytes <= 0:
            break
        deleted.append(bag)
        excess_bytes -= bag.size_bytes
    return deleted
