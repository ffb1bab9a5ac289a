"""Round-trip times between nodes as their agents measured them: one rule for the scheduler and the operator.

- The value of a pair is the worse of its two directions.
- A pair of which no probe was answered is unreachable: its time is infinite, so it exceeds every budget.
- A reading is as old as its round (`seq`): it is unknown when three of its periods have passed since the reader first received
  that round, at the latest after a day. A period is `intervalSeconds` times `everyRounds`. Writing the same round again does not refresh a reading,
  nor do two programs that write one status in turn, each always the same round.
"""

from collections.abc import Hashable, Iterable, Mapping
from math import inf, isinf
from sys import intern
from typing import Any, Final, NamedTuple, TypeVar

import msgspec

T = TypeVar("T", bound=Any)

UNREACHABLE_US: Final = inf
MOVED: Final = 0.2
"""Share by which a figure must differ from the published one to be published anew, and to be called newer."""
PERIODS_KEPT: Final = 3
LONGEST_S: Final = 86_400.0
"""No reading counts for longer, whatever its agent writes of its periods: 1,000 zones of 5000 nodes are measured within 21 hours."""
INTERVAL_S: Final = 10
"""Heartbeat of an agent that names none."""
LONGEST_INTERVAL_S: Final = 3600
MOST_ROUNDS: Final = 100_000
"""The schema's bounds, for readers that may meet what was stored before they were."""
_MILLION: Final = 1_000_000
_NEVER_S: Final = inf


class Rtt(msgspec.Struct, rename="camel", frozen=True, gc=False, kw_only=True):
    """An entry of NodeTelemetry's `status.rtt`; without times when no probe was answered."""

    peer: str = ""
    p50_us: int | None = None
    p95_us: int | None = None
    jitter_us: int | None = None
    loss_ppm: int | None = msgspec.field(name="lossPPM", default=None)
    seq: int | None = None
    every_rounds: int | None = None


class Figures(NamedTuple):
    """Microseconds; UNREACHABLE_US where no probe was answered."""

    p50_us: float
    p95_us: float

    def of(self, percentile: int) -> float:
        """The median for 50, else the 95th percentile."""
        return self.p95_us if percentile >= 95 else self.p50_us


SAME_NODE: Final = Figures(50.0, 50.0)
"""Two ends on one node, by definition."""


def figures_of(entry: Rtt) -> Figures:
    """The times of one entry. The 95th percentile stands in for a median that is missing."""
    lost = entry.loss_ppm is not None and entry.loss_ppm >= _MILLION
    p95_us = UNREACHABLE_US if lost or entry.p95_us is None else float(entry.p95_us)
    return Figures(p95_us if lost or entry.p50_us is None else float(entry.p50_us), p95_us)


def without_round_trips(telemetry: T) -> T:
    """A NodeTelemetry as it is kept once `RoundTrips` has received it: at 5000 nodes its 300,000 entries are 80 MB."""
    status = telemetry.status
    return msgspec.structs.replace(telemetry, status=msgspec.structs.replace(status, rtt=status.rtt[:0]))


def worse(one: Figures | None, other: Figures) -> Figures:
    """The higher of each."""
    if one is None:
        return other
    return Figures(max(one.p50_us, other.p50_us), max(one.p95_us, other.p95_us))


def is_unreachable(time_us: float | None) -> bool:
    """Was no probe answered?"""
    return time_us is not None and isinf(time_us)


class _Span(NamedTuple):
    """From when a round was first received until its times count no more."""

    first_s: float
    end_s: float


class _Report(NamedTuple):
    """What one node's agent reported. `live`: the times that count. `seen`: when each of its rounds was first received."""

    live: Mapping[str, Figures]
    spans: Mapping[str, _Span]
    seen: Mapping[Hashable, float]
    next_s: float = _NEVER_S
    """When the first of `live` expires."""
    since_s: float = 0.0
    """When the round of the status as a whole was first received."""
    interval_s: float = INTERVAL_S
    before: Mapping[Hashable, float] = {}
    """`seen` of the latest report that named other rounds."""

    def first_s(self, mark: Hashable, now_s: float) -> float:
        """When this round was first received, `now_s` for one that is new."""
        known = self.seen.get(mark)
        if known is None and isinstance(mark, int):  # equal figures without a number may well be measured again
            known = self.before.get(mark)
        return now_s if known is None else known


_NOTHING: Final = _Report({}, {}, {})


class RoundTrips:
    """The readings of all nodes. Times are seconds of the reader's monotonic clock."""

    def __init__(self) -> None:
        self._reports: dict[str, _Report] = {}
        self._seen_by: dict[str, set[str]] = {}

    def __repr__(self) -> str:
        return f"<RoundTrips: {len(self._reports)} agents>"

    def receive(
        self, node: str, rtt: Iterable[Rtt], *, seq: int | None, interval_s: float | None, now_s: float
    ) -> frozenset[str]:
        """Take in a node's status. Returns the peers to which its times are others than before."""
        old = self._reports.get(node, _NOTHING)
        interval_s = min(interval_s or INTERVAL_S, LONGEST_INTERVAL_S)
        since_s = now_s if seq is None else old.first_s(seq, now_s)
        seen: dict[Hashable, float] = {} if seq is None else {seq: since_s}
        live: dict[str, Figures] = {}
        spans: dict[str, _Span] = {}
        shared: dict[tuple[Hashable, int], _Span] = {}
        """Readings of one round share their span: at 5000 nodes there are 300,000 of them."""
        for entry in rtt:
            figures = figures_of(entry)
            own_seq = seq if entry.seq is None else entry.seq
            mark = (entry.peer, figures) if own_seq is None else own_seq
            rounds = min(entry.every_rounds or 1, MOST_ROUNDS)
            span = shared.get((mark, rounds))
            if span is None:
                first_s = seen.setdefault(mark, old.first_s(mark, now_s))
                kept_s = min(PERIODS_KEPT * interval_s * rounds, LONGEST_S)
                span = shared[mark, rounds] = _Span(first_s, first_s + kept_s)
            if span.end_s > now_s:
                peer = intern(entry.peer)  # every node's name is in the reports of many others
                live[peer] = figures
                spans[peer] = span
        next_s = min((span.end_s for span in spans.values()), default=_NEVER_S)
        before = old.before if old.seen.keys() == seen.keys() else old.seen
        return self._replace(node, old, _Report(live, spans, seen, next_s, since_s, interval_s, before))

    def drop(self, node: str) -> frozenset[str]:
        """The node's object is gone. Returns the peers to which its times were known."""
        gone = self._replace(node, self._reports.get(node, _NOTHING), _NOTHING)
        self._reports.pop(node, None)
        return gone

    def suppose(self, one: str, other: str, figures: Figures, *, now_s: float) -> None:
        """Let the pair have these times from now on, whatever was measured. For a copy that is asked what would be."""
        for near, far in ((one, other), (other, one)):
            old = self._reports.get(near, _NOTHING)
            live, spans = {**old.live, far: figures}, {**old.spans, far: _Span(now_s, _NEVER_S)}
            self._replace(near, old, old._replace(live=live, spans=spans))

    def expire(self, now_s: float) -> dict[str, frozenset[str]]:
        """Forget times that grew too old. Returns the peers they were of, by node."""
        late = [(node, report) for node, report in self._reports.items() if report.next_s <= now_s]
        return {node: self._replace(node, report, _kept(report, now_s)) for node, report in late}

    def between(self, one: str, other: str) -> Figures | None:
        """The worse of the two directions, None when neither is known."""
        found = None
        for near, far in ((one, other), (other, one)):
            figures = self._reports.get(near, _NOTHING).live.get(far)
            found = found if figures is None else worse(found, figures)
        return found

    def age_s(self, one: str, other: str, *, now_s: float) -> float | None:
        """Seconds since the round was received that decides the pair's p95, None when the pair is not measured."""
        found = [
            (report.live[far].p95_us, report.spans[far].first_s)
            for near, far in ((one, other), (other, one))
            if far in (report := self._reports.get(near, _NOTHING)).live
        ]
        return now_s - max(found)[1] if found else None

    def around(self, node: str) -> dict[str, Figures]:
        """The same for every peer of a node that is known."""
        found = dict(self._reports.get(node, _NOTHING).live)
        for other in self._seen_by.get(node, ()):
            found[other] = worse(found.get(other), self._reports[other].live[node])
        return found

    def silent_from_s(self, node: str) -> float:
        """From when the node's agent counts as silent, and all it reported as unknown."""
        report = self._reports.get(node, _NOTHING)
        return report.since_s + PERIODS_KEPT * report.interval_s

    def oldest_s(self) -> float | None:
        """When the oldest status of which a time still counts was received, None without any."""
        return min((report.since_s for report in self._reports.values() if report.live), default=None)

    def reported(self, node: str) -> Mapping[str, Figures]:
        """What the node's own agent measured. The same object as long as nothing in it changes."""
        return self._reports.get(node, _NOTHING).live

    def _replace(self, node: str, old: _Report, new: _Report) -> frozenset[str]:
        if new.live == old.live:
            self._reports[node] = new._replace(live=old.live)
            return frozenset()
        self._reports[node] = new
        for peer in old.live.keys() - new.live.keys():
            self._seen_by[peer].discard(node)
            if not self._seen_by[peer]:
                del self._seen_by[peer]
        for peer in new.live.keys() - old.live.keys():
            self._seen_by.setdefault(peer, set()).add(node)
        peers = old.live.keys() | new.live.keys()
        return frozenset(peer for peer in peers if old.live.get(peer) != new.live.get(peer))


def _kept(report: _Report, now_s: float) -> _Report:
    live = {peer: figures for peer, figures in report.live.items() if report.spans[peer].end_s > now_s}
    return report._replace(live=live, next_s=min((report.spans[peer].end_s for peer in live), default=_NEVER_S))
