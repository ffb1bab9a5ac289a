"""When the probes of a round are sent, and what it measured per peer: round-trip times, jitter and loss. Pure."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

PROBES: Final = 10
"""To each peer in a round."""
LOSS_ROUNDS: Final = 12
"""Rounds over which losses count: 120 probes, two minutes of the shortest heartbeat. Ten probes cannot show one percent."""
MOST_GROUPS: Final = 4
"""Moments of each tenth of a round at which probes leave: waking up costs the process more than ten probes do."""
MOST_WINDOWS: Final = 256
MOST_TIMEOUT_S: Final = 2.0
_MILLION: Final = 1_000_000

Trips = Sequence[int | None]
"""Round trips in microseconds in the order of the requests; None where no reply came."""


class RoundResult(NamedTuple):
    """One peer in one round. Without times nothing was answered in this round and the peer's round before: the peer is
    unreachable and `loss_ppm` is 1,000,000.
    """

    peer: str
    p50_us: int | None
    p95_us: int | None
    jitter_us: int | None
    """Mean difference between consecutive round trips (RFC 3550's difference, without its smoothing over earlier rounds); None
    with fewer than two answers."""
    loss_ppm: int
    """Probes without an answer, per million, over the last LOSS_ROUNDS rounds since the peer's last round of silence."""
    sent: int
    """Of this round, as is `answered`."""
    answered: int


class Round(NamedTuple):
    """All peers of one round."""

    results: tuple[RoundResult, ...] = ()
    silent: tuple[str, ...] = ()
    """Peers that answered nothing, but did in their round before, or had none. Their agent may be restarting, which takes no link
    away, and be back at another address: look for it. Nothing is known of them in this round."""
    discarded: str = ""
    """Why nothing in this round counts (the machine slept, the process stood still), else ""."""


class Shot(NamedTuple):
    """When to send one probe each to some of the peers."""

    offset_s: float
    peers: range


def timeout_s(seconds: float) -> float:
    """How long a reply may take in a round of `seconds`."""
    return min(MOST_TIMEOUT_S, seconds / 5)


def schedule(peers: int, *, seconds: float, uniform: Callable[[], float]) -> tuple[Shot, ...]:
    """PROBES to each peer in time order. Chance decides when in its tenth of the round a probe leaves, so that it does not keep
    step with anything periodic, such as the beacons of a Wi-Fi; the last ones still have the time for their answer.
    """
    step_s = (seconds - timeout_s(seconds)) / PROBES
    groups = [range(first, peers, MOST_GROUPS) for first in range(min(peers, MOST_GROUPS))]
    shots = (Shot((number + uniform()) * step_s, group) for number in range(PROBES) for group in groups)
    return tuple(sorted(shots, key=lambda shot: shot.offset_s))


class RoundSummary:
    """Turns the round trips of each round into figures. Remembers the losses of the MOST_WINDOWS latest peers."""

    def __init__(self) -> None:
        self._peers: dict[str, _Peer] = {}

    def __repr__(self) -> str:
        return f"<RoundSummary of {len(self._peers)} peers>"

    def round(self, trips: Mapping[str, Trips]) -> Round:
        """Figures of all peers to which something was sent."""
        results, silent = [], []
        for name, found in trips.items():
            if found:
                self._peers[name] = peer = self._peers.pop(name, None) or _Peer()
                loss_ppm = peer.loss_ppm(found)
                if peer.silent_rounds == 1:
                    silent.append(name)
                else:
                    results.append(_result(name, found, loss_ppm))
        for name in list(self._peers)[:-MOST_WINDOWS]:
            del self._peers[name]
        return Round(tuple(results), tuple(silent))


class _Peer:
    def __init__(self) -> None:
        self.silent_rounds = 0
        """In a row, up to now."""
        self._losses: deque[tuple[int, int]] = deque(maxlen=LOSS_ROUNDS)
        """(sent, lost) of each round."""

    def loss_ppm(self, trips: Trips) -> int:
        if all(each is None for each in trips):  # the link or the agent is down, which is not loss
            self._losses.clear()
            self.silent_rounds += 1
            return _MILLION
        if self.silent_rounds:  # before the first answer it was still down
            trips = trips[next(index for index, each in enumerate(trips) if each is not None) :]
            self.silent_rounds = 0
        self._losses.append((len(trips), sum(each is None for each in trips)))
        sent, lost = sum(each[0] for each in self._losses), sum(each[1] for each in self._losses)
        return (_MILLION * lost + sent // 2) // sent


def _result(peer: str, trips: Trips, loss_ppm: int) -> RoundResult:
    times_us = [each for each in trips if each is not None]
    if not times_us:
        return RoundResult(peer, None, None, None, loss_ppm, len(trips), 0)
    ordered = sorted(times_us)
    p50_us, p95_us = quantile(ordered, 50), quantile(ordered, 95)
    return RoundResult(peer, p50_us, p95_us, jitter_us(times_us), loss_ppm, len(trips), len(times_us))


def quantile(ordered: Sequence[int], percent: int) -> int:
    """The nearest rank: a value that was measured."""
    return ordered[-(-percent * len(ordered) // 100) - 1]


def jitter_us(times_us: Sequence[int]) -> int | None:
    """Mean difference between one round trip and the next."""
    steps = [abs(after - before) for before, after in pairwise(times_us)]
    return round(sum(steps) / len(steps)) if steps else None
