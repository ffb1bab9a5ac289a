"""Bags in a folder: split, bounded, numbered, and read by another library."""

from pathlib import Path

import pytest
from tests.support.bags import CHATTER, TOPIC, read_all, read_numbers, serialize, total_bytes

from robotapp_recorder.listing import list_bags, read_info
from robotapp_recorder.store import BagStore, Limits

KIB = 1024


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.now_ns = 1_700_000_000_000_000_000

    def __call__(self) -> int:
        return self.now_ns


def opened(folder: Path, limits: Limits, clock: Clock | None = None) -> BagStore:
    store = BagStore(folder, "run", limits, clock_ns=clock or Clock())
    store.open()
    store.add_channel(CHATTER)
    return store


def fill(store: BagStore, count: int, *, size_bytes: int = KIB) -> None:
    for number in range(count):
        store.add_message(TOPIC, serialize(number, size_bytes=size_bytes), published_ns=number)


def test_a_bag_that_was_closed_has_all_messages_for_another_reader(tmp_path: Path) -> None:
    store = opened(tmp_path, Limits(split_bytes=KIB * KIB, retain_bytes=4 * KIB * KIB))
    fill(store, 100)
    store.close()
    assert read_all(tmp_path) == list(range(100))
    (bag,) = list_bags(tmp_path)
    assert bag["state"] == "closed"
    info = read_info(tmp_path / bag["name"])
    assert (info["messages"], info["topics"]) == (
        100,
        [{"topic": TOPIC, "type": "std_msgs/msg/String", "messages": 100}],
    )


def test_bags_are_split_by_size_and_the_oldest_go(tmp_path: Path) -> None:
    limits = Limits(split_bytes=64 * KIB, retain_bytes=256 * KIB)
    store = opened(tmp_path, limits)
    for number in range(2000):
        store.add_message(TOPIC, serialize(number, size_bytes=KIB), published_ns=0)
        assert total_bytes(tmp_path) <= limits.retain_bytes
    store.close()
    kept = read_all(tmp_path)
    assert kept == list(range(kept[0], 2000))
    assert len(list_bags(tmp_path)) > 2


def test_bags_are_split_by_time(tmp_path: Path) -> None:
    clock = Clock()
    store = opened(tmp_path, Limits(split_bytes=KIB * KIB, retain_bytes=8 * KIB * KIB, split_ns=60 * 10**9), clock)
    for _ in range(3):
        fill(store, 10)
        clock.now_ns += 60 * 10**9
    store.close()
    assert [len(read_numbers(path)) for path in sorted(tmp_path.glob("*.mcap"))] == [10, 10, 10]


def test_a_clock_that_goes_back_does_not_make_the_newest_bag_the_oldest(tmp_path: Path) -> None:
    clock = Clock()
    for _ in range(3):
        store = opened(tmp_path, Limits(split_bytes=64 * KIB, retain_bytes=64 * KIB), clock)
        fill(store, 3)
        store.close()
        clock.now_ns -= 10**18 // 4
    (bag,) = list_bags(tmp_path)
    assert bag["name"].startswith("run-000003-")


def test_a_message_that_is_larger_than_a_split_has_a_bag_of_its_own(tmp_path: Path) -> None:
    store = opened(tmp_path, Limits(split_bytes=8 * KIB, retain_bytes=64 * KIB))
    fill(store, 1)
    fill(store, 1, size_bytes=32 * KIB)
    fill(store, 1)
    store.close()
    assert len(list_bags(tmp_path)) == 3


def test_an_open_chunk_is_closed_when_it_is_old(tmp_path: Path) -> None:
    clock = Clock()
    store = opened(tmp_path, Limits(split_bytes=KIB * KIB, retain_bytes=KIB * KIB), clock)
    fill(store, 1)
    before = total_bytes(tmp_path)
    clock.now_ns += 2 * 10**9
    store.pass_time()
    assert total_bytes(tmp_path) > before, "what was received a second ago is on disk"
    store.abandon()


def test_the_open_bag_is_named_and_has_no_topics_yet(tmp_path: Path) -> None:
    store = opened(tmp_path, Limits(split_bytes=KIB * KIB, retain_bytes=KIB * KIB))
    fill(store, 1)
    (bag,) = list_bags(tmp_path)
    assert bag["state"] == "open"
    with pytest.raises(ValueError, match="is being written"):
        read_info(tmp_path / bag["name"])
    store.abandon()
