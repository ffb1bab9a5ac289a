"""When the probes of a round are sent, and what it measured per peer: round-trip times, jitter and loss. Pure."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

PROBES: Final = 10
"""To each peer in a round."""
LOSS_ROUNDS: Final = 12
"""Rounds over which losses count: 120 probes, two minutes of the shortest heartbeat. Ten probes cannot show one percent."""
MOST_WINDOWS: Final = 256
MOST_TIMEOUT_S: Final = 2.0
_MILLION: Final = 1_000_000

Trips = Sequence[int | None]
"""Round trips in microseconds in the order of the requests; None where no reply came."""


class RoundResult(NamedTuple):
    """One peer in one round. Without times nothing was answered: the peer is unreachable and `loss_ppm` is 1,000,000."""

    peer: str
    p50_us: int | None
    p95_us: int | None
    jitter_us: int | None
    """Mean difference between consecutive round trips (RFC 3550's difference, without its smoothing over earlier rounds); None
    with fewer than two answers."""
    loss_ppm: int
    """Probes without an answer, per million, over the last LOSS_ROUNDS rounds since the peer was last unreachable."""
    sent: int
    """Of this round, as is `answered`."""
    answered: int


class Round(NamedTuple):
    """All peers of one round. `discarded`: why nothing in it counts (the machine slept, the process stood still), else ""."""

    results: tuple[RoundResult, ...] = ()
    discarded: str = ""


class Shot(NamedTuple):
    """One probe to send: when, and to which of the peers."""

    offset_s: float
    peer: int


def timeout_s(seconds: float) -> float:
    """How long a reply may take in a round of `seconds`."""
    return min(MOST_TIMEOUT_S, seconds / 5)


def schedule(peers: int, *, seconds: float, uniform: Callable[[], float]) -> tuple[Shot, ...]:
    """PROBES to each peer in time order. Chance decides when in its share of the round a probe leaves, so that it does not keep
    step with anything periodic, such as the beacons of a Wi-Fi; the last ones still have the time for their answer.
    """
    step_s = (seconds - timeout_s(seconds)) / PROBES
    shots = [Shot((number + uniform()) * step_s, peer) for number in range(PROBES) for peer in range(peers)]
    return tuple(sorted(shots))


class RoundSummary:
    """Turns the round trips of each round into figures. Keeps the losses of earlier rounds of the MOST_WINDOWS latest peers."""

    def __init__(self) -> None:
        self._windows: dict[str, deque[tuple[int, int]]] = {}

    def __repr__(self) -> str:
        return f"<RoundSummary of {len(self._windows)} peers>"

    def results(self, trips: Mapping[str, Trips]) -> tuple[RoundResult, ...]:
        """Figures of all peers to which something was sent."""
        return tuple(self._result(peer, found) for peer, found in trips.items() if found)

    def _result(self, peer: str, trips: Trips) -> RoundResult:
        times_us = [each for each in trips if each is not None]
        loss_ppm = self._loss_ppm(peer, trips)
        if not times_us:
            return RoundResult(peer, None, None, None, loss_ppm, len(trips), 0)
        ordered = sorted(times_us)
        p50_us, p95_us = quantile(ordered, 50), quantile(ordered, 95)
        return RoundResult(peer, p50_us, p95_us, jitter_us(times_us), loss_ppm, len(trips), len(times_us))

    def _loss_ppm(self, peer: str, trips: Trips) -> int:
        window = self._windows.pop(peer, None)
        self._windows[peer] = window = deque(maxlen=LOSS_ROUNDS) if window is None else window
        if len(self._windows) > MOST_WINDOWS:
            del self._windows[next(iter(self._windows))]
        if all(each is None for each in trips):
            window.clear()  # the link is down, which is more than loss
            window.append((0, 0))
            return _MILLION
        if window and window[-1] == (0, 0):
            trips = _from_first_answer(trips)  # before it the link was still down
            window.clear()
        window.append((len(trips), sum(each is None for each in trips)))
        sent, lost = sum(each[0] for each in window), sum(each[1] for each in window)
        return (_MILLION * lost + sent // 2) // sent


def quantile(ordered: Sequence[int], percent: int) -> int:
    """The nearest rank: a value that was measured."""
    return ordered[-(-percent * len(ordered) // 100) - 1]


def jitter_us(times_us: Sequence[int]) -> int | None:
    """Mean difference between one round trip and the next."""
    steps = [abs(after - before) for before, after in pairwise(times_us)]
    return round(sum(steps) / len(steps)) if steps else None


def _from_first_answer(trips: Trips) -> Trips:
    first = next(index for index, each in enumerate(trips) if each is not None)
    return trips[first:]
