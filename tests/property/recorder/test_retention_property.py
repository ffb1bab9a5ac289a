"""Whatever is recorded, and however often the recorder is killed: the bags stay within their bound, and open."""

import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.bags import CHATTER, TOPIC, read_all, serialize, total_bytes

from robotapp_recorder.retention import Bag, choose_deleted
from robotapp_recorder.store import BagStore, Limits

SPLIT, RETAIN = 16 << 10, 64 << 10
BAGS = st.lists(st.integers(0, 1000), max_size=20).map(
    lambda sizes: [Bag(f"run-{number:06d}", size) for number, size in enumerate(sizes)]
)
LIVES = st.lists(st.lists(st.integers(32, 6 << 10), max_size=60), min_size=1, max_size=6)


@given(BAGS, st.integers(0, 500), st.integers(0, 5000))
def test_the_oldest_go_and_no_more_than_needed(bags: list[Bag], split: int, more: int) -> None:
    retain = split + more
    deleted = choose_deleted(bags, retain_bytes=retain, split_bytes=split)
    kept = [bag for bag in bags if bag not in deleted]
    assert deleted == bags[: len(deleted)]
    assert sum(bag.size_bytes for bag in kept) + split <= retain
    if deleted:
        assert sum(bag.size_bytes for bag in [deleted[-1], *kept]) + split > retain


@settings(max_examples=40, deadline=None)
@given(LIVES)
def test_the_bound_holds_through_kills_and_what_is_left_is_in_order(lives: list[list[int]]) -> None:
    """An abandoned bag is as a killed process leaves it, because every chunk goes to the kernel at once."""
    with tempfile.TemporaryDirectory() as name:
        folder, number = Path(name), 0
        for sizes in lives:
            store = BagStore(folder, "run", Limits(SPLIT, RETAIN))
            store.open()
            assert total_bytes(folder) <= RETAIN
            store.add_channel(CHATTER)
            for size in sizes:
                store.add_message(TOPIC, serialize(number, size_bytes=size), published_ns=0)
                number += 1
                assert total_bytes(folder) <= RETAIN
            store.abandon()
        last = BagStore(folder, "run", Limits(SPLIT, RETAIN))
        last.open()
        kept = read_all(folder)
        assert kept == sorted(set(kept))
        assert not list(folder.glob("*.open"))
