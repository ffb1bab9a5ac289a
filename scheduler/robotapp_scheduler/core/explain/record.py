"""One record per pod of its last decision, with reasons and scores, for `/explain`; bounded, the oldest are dropped."""

from collections import OrderedDict
from itertools import islice
from typing import Any, Final, NamedTuple

import msgspec

KEPT: Final = 2000
KEPT_BYTES: Final = 20_000_000
MOST_REFUSALS: Final = 50
"""Reasons kept per record, the most frequent ones: with a different taint on every node there are thousands."""
TOP: Final = 10
EXAMPLES: Final = 3


class Example(msgspec.Struct, frozen=True, gc=False, rename="camel", omit_defaults=True):
    """One node that was rejected for a reason; `number` is the plugin's `detail` of it.

    Where the number is the RTT of a connection, the others are about that connection: where its other end is, its budget in
    ms, and how the RTT was known (measured, estimated).
    """

    node: str
    number: float | None = None
    peer_node: str = ""
    budget_ms: float | None = None
    source: str = ""


class Refusal(msgspec.Struct, frozen=True, gc=False, rename="camel"):
    """One reason: its plugin, the number of nodes, and up to three of them."""

    plugin: str
    reason: str
    nodes: int
    unit: str = ""
    examples: tuple[Example, ...] = ()


class Top(msgspec.Struct, frozen=True, gc=False, rename="camel"):
    """The best nodes, the chosen one first: totals, and per plugin the normalised score on each of them."""

    nodes: tuple[str, ...] = ()
    totals: tuple[int, ...] = ()
    weights: dict[str, int] = {}
    scores: dict[str, tuple[int, ...]] = {}
    shadow: tuple[str, ...] = ()
    """Plugins that are scored but not counted in the totals."""


class EdgeView(msgspec.Struct, frozen=True, gc=False, rename="camel"):
    """A connection of the pod from its chosen node: RTT against budget, and how the RTT is known."""

    what: str
    peer_node: str
    rtt_ms: float | None
    budget_ms: float | None
    source: str
    """measured (this pair), estimated (zones) or unknown."""
    met: bool | None
    percentile: int = 95


class Record(msgspec.Struct, gc=False, rename="camel"):
    """One decision. `at_s` is the scheduler's monotonic clock."""

    namespace: str
    name: str
    uid: str
    at_s: float
    profile: str
    config_hash: str
    attempt: int
    node: str | None
    message: str
    nodes: int
    feasible: int
    refusals: tuple[Refusal, ...] = ()
    top: Top = msgspec.field(default_factory=Top)
    runner_up: str | None = None
    edges: tuple[EdgeView, ...] = ()
    devices: tuple[str, ...] = ()
    shadow_changes: tuple[str, ...] = ()
    """Shadow plugins that would have changed the choice."""
    planned: str = ""
    """How the plan of its group was made and followed; empty for a pod that was placed alone."""
    tier: str = ""
    """Why a node of this tier was chosen; empty where `runsOn` leaves no choice."""
    seed: int = 0
    """Tie-break seed: with pod uid and node names it reproduces the choice among equal totals."""


class Scorers(NamedTuple):
    """The plugins that score pods of one class. The same object as long as these do not change."""

    weights: dict[str, int]
    """By plugin, in the order of the profile."""
    shadows: tuple[str, ...]
    same: dict[str, int]
    """Scores of the plugins that give all rows the same score."""
    differing: tuple[str, ...]
    """The other plugins."""


class NodePluginScores(msgspec.Struct, frozen=True, gc=False):
    """One row: its node, its total, and the normalised scores of `Scorers.differing`, in that order."""

    position: int
    node: str
    total: int
    scores: tuple[int, ...]


class TopNodes(NamedTuple):
    """The best rows at the time of a decision, at most TOP, best first. Decisions with the same best rows share the object."""

    positions: tuple[int, ...]
    nodes: tuple[str, ...]
    totals: tuple[int, ...]
    scores: tuple[tuple[int, ...], ...]
    """By plugin of `Scorers.differing`, then by row."""
    scorers: Scorers


NO_NODES: Final = TopNodes((), (), (), (), Scorers({}, (), {}, ()))


class ChosenNode(msgspec.Struct, frozen=True, gc=False):
    """The chosen row and the best rows at that moment; `top` sorts them only when a record is read."""

    front: TopNodes
    chosen: NodePluginScores

    @property
    def weight_bytes(self) -> int:
        """Upper estimate of the memory that its `top` takes."""
        return top_bytes(len(self.front.scorers.weights), len(self.front.positions))

    def top(self) -> Top:
        """The chosen row first, then the best of the others."""
        chosen, front, scorers = self.chosen, self.front, self.front.scorers
        others = [place for place, position in enumerate(front.positions) if position != chosen.position]
        others = others[: max(len(front.positions) - 1, 0)]
        differing = {
            plugin: (own, *map(scores.__getitem__, others))
            for plugin, own, scores in zip(scorers.differing, chosen.scores, front.scores, strict=True)
        }
        return Top(
            nodes=(chosen.node, *map(front.nodes.__getitem__, others)),
            totals=(chosen.total, *map(front.totals.__getitem__, others)),
            weights=scorers.weights,
            scores={
                plugin: differing[plugin] if plugin in differing else (scorers.same[plugin],) * (1 + len(others))
                for plugin in scorers.weights
            },
            shadow=scorers.shadows,
        )


def finished(record: Record, best: ChosenNode | None) -> Record:
    """The record with its best nodes written out."""
    if best is None:
        return record
    top = best.top()
    return msgspec.structs.replace(record, top=top, runner_up=top.nodes[1] if len(top.nodes) > 1 else None)


def top_bytes(plugins: int, nodes: int) -> int:
    """What the best nodes take in memory, estimated from above."""
    return (plugins + 1) * nodes * 32 + 100 * plugins


def weight_bytes(record: Record) -> int:
    """What a record keeps in memory, estimated from above: measuring it would cost more than making it."""
    top = record.top
    weight = 1000 + 2 * (len(record.message) + len(record.namespace) + len(record.name))
    if top.nodes:
        weight += top_bytes(len(top.scores), len(top.nodes))
    for refusal in record.refusals:
        weight += 200 + 2 * len(refusal.reason) + 150 * len(refusal.examples)
    if record.edges or record.devices:
        weight += 400 * len(record.edges) + 100 * len(record.devices)
    return weight


class ExplainRing:
    """The latest record of up to `kept` pods and `kept_bytes` of memory, oldest dropped first."""

    def __init__(self, kept: int = KEPT, kept_bytes: int = KEPT_BYTES) -> None:
        self._kept = kept
        self._kept_bytes = kept_bytes
        self._bytes = 0
        self._records: OrderedDict[str, tuple[Record, ChosenNode | None, int]] = OrderedDict()
        """By pod uid, with what each weighs."""

    def __len__(self) -> int:
        return len(self._records)

    def __repr__(self) -> str:
        return f"ExplainRing({len(self._records)} of {self._kept}, {self._bytes >> 10} KiB)"

    @property
    def size_bytes(self) -> int:
        """Memory the records may take, estimated from above."""
        return self._bytes

    def add(self, record: Record, best: ChosenNode | None = None) -> None:
        """Keep a record in place of an older one of the same pod. With `best` it gets its best nodes when it is read."""
        records, uid = self._records, record.uid
        if uid in records:
            self._bytes -= records.pop(uid)[2]
        weight = weight_bytes(record) + (best.weight_bytes if best is not None else 0)
        records[uid] = (record, best, weight)
        self._bytes += weight
        while len(records) > self._kept or (self._bytes > self._kept_bytes and len(records) > 1):
            self._bytes -= records.popitem(last=False)[1][2]

    def correct(self, uid: str, message: str) -> None:
        """The pod got no node after all: its group is placed whole or not at all."""
        record = self.get(uid)
        if record is not None and record.node is not None:
            self.add(msgspec.structs.replace(record, node=None, message=message))

    def get(self, uid: str) -> Record | None:
        """By pod uid."""
        found = self._records.get(uid)
        return finished(found[0], found[1]) if found is not None else None

    def find(self, namespace: str, name: str) -> Record | None:
        """By name: the pod of this name that was tried last."""
        for record, best, _ in reversed(self._records.values()):  # called too seldom for an index
            if record.name == name and record.namespace == namespace:
                return finished(record, best)
        return None

    def latest(self, count: int) -> list[Record]:
        """The newest records first."""
        newest = islice(reversed(self._records.values()), count)
        return [finished(record, best) for record, best, _ in newest]


def as_json(record: Record) -> dict[str, Any]:
    """Plain JSON of a record, camelCase."""
    plain: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(record))
    return plain


def histogram(total: int, counts: dict[str, int]) -> str:
    """kube-scheduler's text (FitError) for a pod no node accepts; entries are sorted as strings ("10 x" before "2 y")."""
    if total == 0:
        return "no nodes available to schedule pods"
    entries = sorted(f"{count} {reason}" for reason, count in counts.items() if count)
    return f"0/{total} nodes are available" + (f": {', '.join(entries)}." if entries else ".")


def pre_filter_message(total: int, text: str) -> str:
    """The text when a pre_filter rejected the pod."""
    return f"0/{total} nodes are available: {text}."
