"""Chooses topics of the graph, and the quality of service of their subscriptions. Pure."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class Selection:
    """Topics that a recording wants: names, and a regular expression that a whole name must match; `exclude` takes topics out again."""

    names: frozenset[str] = frozenset()
    regex: str = ""
    exclude: str = ""

    def wants(self, topic: str) -> bool:
        """Returns whether a topic is recorded."""
        if self.exclude and re.fullmatch(self.exclude, topic):
            return False
        return topic in self.names or bool(self.regex and re.fullmatch(self.regex, topic))


class Offer(NamedTuple):
    """Type and quality of service of one publisher."""

    type_name: str
    reliable: bool
    transient_local: bool


class Wanted(NamedTuple):
    """A subscription that every publisher of the topic matches, with the strictest service that all of them offer."""

    topic: str
    type_name: str
    reliable: bool
    transient_local: bool


def choose_subscriptions(
    selection: Selection, offers: Mapping[str, Sequence[Offer]], subscribed: Iterable[str]
) -> tuple[list[Wanted], list[str]]:
    """Returns what to subscribe to now, and a line for each topic that cannot be recorded."""
    subscriptions: list[Wanted] = []
    problems: list[str] = []
    recorded_topics = set(subscribed)
    for topic, publishers in sorted(offers.items()):
        if not publishers or topic in recorded_topics or not selection.wants(topic):
            continue
        types = sorted({offer.type_name for offer in publishers})
        if len(types) > 1:
            problems.append(f"{topic} is not recorded: its publishers have different types ({', '.join(types)})")
            continue
        reliable = all(offer.reliable for offer in publishers)
        transient_local = all(offer.transient_local for offer in publishers)
        subscriptions.append(Wanted(topic, types[0], reliable, transient_local))
    return subscriptions, problems


def describe_qos(wanted: Wanted, *, depth: int) -> str:
    """Returns the offered quality of service as rosbag2 writes it into the metadata of a channel."""
    reliability = "reliable" if wanted.reliable else "best_effort"
    durability = "transient_local" if wanted.transient_local else "volatile"
    endless = "sec: 9223372036\n    nsec: 854775807"
    return (
        f"- history: keep_last\n  depth: {depth}\n  reliability: {reliability}\n  durability: {durability}\n"
        f"  deadline:\n    {endless}\n  lifespan:\n    {endless}\n  liveliness: automatic\n"
        f"  liveliness_lease_duration:\n    {endless}\n  avoid_ros_namespace_conventions: false\n"
    )
