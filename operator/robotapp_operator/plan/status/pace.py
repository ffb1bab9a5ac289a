"""When a status may be written: urgent changes soon, mere progress seldom."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.model.names import Condition, Phase, Reason

BURST: Final = 3
"""Writes of an app's status without a pause: its generation observed, a domain, ready."""
LEAST_TOKENS: Final = -1.0
"""However often an app is edited, what came of the last edit is told after two periods."""
EVERY_S: Final = 1.0
EDGES_PER_S: Final = 64
"""The server checks the whole spec again with each status write; that takes longer the more edges there are."""
START_REST_S: Final = (1.0, 5.0, 15.0)
"""Pauses before writes of an app's status that only show how far its start has come: the first, the second, every further one."""
CROWD_REST_S: Final = 0.5
"""Such a pause has so many seconds per app that starts: together they show their progress twice per second."""
MOST_START_REST_S: Final = 120.0
START_S: Final = 150.0
"""An app whose start has shown nothing new for so long does not count as one that starts: it may be stuck, and for ever."""
FEW_LEFT: Final = 0.1
"""Share of a crowd that is no crowd any more: the others have arrived, and what keeps these may be of interest."""
LONGEST_START_S: Final = 600.0
"""Nor does one that began longer ago: a few apps that never get ready must not slow what is shown of all others."""
SETTLED_S: Final = 0.5
"""An urgent change is written when it has lasted this long: a starting pod passes through states that end at once."""
URGENT_REST_S: Final = 1.0
PROGRESS_REST_S: Final = (15.0, 60.0)
"""Pauses between writes that only show how far a start has come: the first, and every further one."""
STILL_S: Final = 10.0
"""A difference that has not changed for so long is written although the pause is not over; later where many apps start."""
_ARRIVED = frozenset({Phase.RUNNING, Phase.DEGRADED, Phase.OFFLINE, Phase.SUSPENDED, Phase.FAILED})
_ON_THE_WAY = frozenset({Reason.PENDING, Reason.COMPONENTS_NOT_READY, Reason.UNSCHEDULABLE})
"""Reasons of a normal start, which are not urgent: a new pod is often refused once, until the others of its group are there."""
_TELLING = frozenset({Condition.READY, Condition.ACCEPTED, Condition.BUDGET_MET})
_STARTING = frozenset({Phase.PENDING, Phase.PLACING})
_STEPS = frozenset(
    {
        Reason.PENDING,
        Reason.ACCEPTED,
        Reason.NOTHING_TO_ALLOCATE,
        Reason.NOT_OUR_SCHEDULER,
        Reason.ALLOCATED,
        Reason.WAITING_FOR_PODS,
        Reason.WAITING_FOR_DEVICES,
        Reason.PLACED,
        Reason.NO_BUDGET,
        Reason.NOT_MEASURED,
        Reason.WITHIN_BUDGET,
        Reason.COMPONENTS_NOT_READY,
        Reason.ROLLING_OUT,
        Reason.UP_TO_DATE,
        Reason.NOT_STALLED,
    }
)
"""Reasons that conditions have while an app starts as it should."""


class Crowd:
    """The apps that start now: all that was found of them since their first status was progress, the last within `START_S`.

    On a slow machine a crowd takes minutes. Apps that left it after one would then write their progress as often as one alone.

    It counts whole, at its largest size, until `FEW_LEFT` of it is left, or for about `MOST_START_REST_S`. A crowd gets Ready
    within seconds: as it shrank, so would the pauses of those that are left, and each would write its progress just before it
    is Ready. The few that are left then are to be looked at again (`take_few`): their pauses are shorter now.
    """

    def __init__(self) -> None:
        self._seen: dict[str, tuple[float, float]] = {}
        """By uid: when the app's start was last seen to go on, the longest ago first, and when it began."""
        self._endless: set[str] = set()
        """Apps whose start has taken too long to count; an edit makes it no new one."""
        self._largest = (0, float("-inf"))
        """Its largest size, and when it last had that."""
        self._few: set[str] = set()

    def __repr__(self) -> str:
        return f"Crowd({len(self._seen)})"

    def note(self, uid: str, *, starts: bool, begins: bool, now_s: float) -> int:
        """How many apps start together, now that this app, whose status has changed, does or does not.

        begins: it has no status yet, or one of an older generation.
        """
        self.size(now_s)
        _, began_s = self._seen.pop(uid, (now_s, now_s if begins else None))
        if not starts:
            self._endless.discard(uid)
        elif began_s is not None and uid not in self._endless:
            if now_s - began_s < LONGEST_START_S:
                self._seen[uid] = now_s, began_s
            else:
                self._endless.add(uid)
        return self._size(now_s)

    def leave(self, uid: str) -> None:
        """The app is gone, as if it had never been one of them."""
        if self._seen.pop(uid, None) is not None:
            self._largest = self._largest[0] - 1, self._largest[1]
        self._endless.discard(uid)
        self._few.discard(uid)

    def take_few(self) -> set[str]:
        """Uids of the apps that were left of a crowd when it ended; each is given once."""
        few, self._few = self._few, set()
        return few

    def size(self, now_s: float) -> int:
        while self._seen:
            uid, (seen_s, _) = next(iter(self._seen.items()))
            if now_s - seen_s < START_S:
                break
            del self._seen[uid]
        return self._size(now_s)

    def _size(self, now_s: float) -> int:
        size, (largest, at_s) = len(self._seen), self._largest
        is_over = size <= FEW_LEFT * largest
        if is_over:
            self._few |= self._seen.keys()
        if size >= largest or is_over or now_s - at_s > MOST_START_REST_S:
            self._largest = size, now_s
        return self._largest[0]


@dataclasses.dataclass(slots=True)
class Bucket:
    """Writes of one app's status: `BURST` at once, and one per period in the long run. Times are monotonic seconds.

    Unlike `values.buckets` its period depends on the app's edges, and a write that cannot wait runs it into debt.
    `steps`: writes in a row that only showed progress (`is_progress`).
    """

    tokens: float = BURST
    at_s: float = float("-inf")
    steps: int = 0

    def wait_s(self, now_s: float, *, edges: int, progress: bool = False, starting: int = 1) -> float:
        """0 when one may be written now. starting: how many apps start."""
        missing = 1.0 - self._filled(now_s, edges)
        rest_s = self._start_rest_s(starting) if progress else 0.0
        return max(0.0, missing * _period_s(edges), self.at_s + rest_s - now_s)

    def take(self, now_s: float, *, edges: int, progress: bool = False) -> None:
        self.tokens = max(LEAST_TOKENS, self._filled(now_s, edges) - 1.0)
        self.at_s = now_s
        self.steps = self.steps + 1 if progress else 0

    def _start_rest_s(self, starting: int) -> float:
        least_s = START_REST_S[min(self.steps, len(START_REST_S) - 1)]
        return max(least_s, crowd_rest_s(starting))

    def _filled(self, now_s: float, edges: int) -> float:
        return min(float(BURST), self.tokens + (now_s - self.at_s) / _period_s(edges))


def crowd_rest_s(starting: int) -> float:
    """The least pause between writes that only show progress, where so many apps start."""
    return min(CROWD_REST_S * starting, MOST_START_REST_S)


def _period_s(edges: int) -> float:
    return EVERY_S * max(1.0, edges / EDGES_PER_S)


@dataclasses.dataclass(slots=True)
class Writing:
    """What is known of the writes of one RobotAppInstance. Times are monotonic seconds.

    `differs_s`: since when its status differs from the stored one. `moved_s`: when that difference last changed. `steps`:
    writes in a row that only showed progress.
    """

    written_s: float = float("-inf")
    differs_s: float | None = None
    moved_s: float = float("-inf")
    steps: int = 0

    def due_s(self, now_s: float, *, moved: bool, urgent: bool, ready: bool, starting: int = 1) -> float:
        """The second at which the status, which differs from the stored one, is to be written. moved: it has changed.
        starting: how many apps start.
        """
        if self.differs_s is None:
            self.differs_s = now_s
        if moved:
            self.moved_s = now_s
        if urgent:
            return max(self.differs_s + (0.0 if ready else SETTLED_S), self.written_s + URGENT_REST_S)
        rest_s, least_s = PROGRESS_REST_S[min(self.steps, len(PROGRESS_REST_S) - 1)], crowd_rest_s(starting)
        return min(self.written_s + max(rest_s, least_s), self.moved_s + max(STILL_S, least_s))

    def wrote(self, now_s: float, *, urgent: bool) -> None:
        quiet = now_s - self.written_s > PROGRESS_REST_S[-1]
        self.steps = 0 if urgent or quiet else self.steps + 1
        self.written_s, self.differs_s = now_s, None

    def same(self) -> None:
        self.differs_s = None


def is_urgent(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Does the instance run now, or no longer, fail for a new reason, or no longer fail?"""
    if after.get("phase") != before.get("phase") and has_arrived(after):
        return True
    old, new = _verdicts(before), _verdicts(after)
    turned = [kind for kind in new if old.get(kind) != new[kind]]
    fails = any(new[kind][0] == "False" and new[kind][1] not in _ON_THE_WAY for kind in turned)
    ended = old.get(Condition.READY, ("",))[0] == "True" and Condition.READY in turned
    mended = any(old.get(kind, ("",))[0] == "False" for kind in turned if kind != Condition.READY)
    return fails or ended or mended


def has_arrived(status: Mapping[str, Any]) -> bool:
    """Is the start over that this status is of, in whatever way?"""
    return status.get("phase") in _ARRIVED


def is_progress(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Does the app's status only show how far a normal start has come?

    Anything that the user may have to act on, or waits for, is no progress: a refusal, a failure, an app that is Ready.
    """
    return is_start(before) and is_start(after)


def is_start(status: Mapping[str, Any]) -> bool:
    """Is it the status of an app that starts as it should?"""
    return status.get("phase") in _STARTING and {reason for _, reason in _all_verdicts(status).values()} <= _STEPS


def _verdicts(status: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    return {kind: verdict for kind, verdict in _all_verdicts(status).items() if kind in _TELLING}


def _all_verdicts(status: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """Status and reason by condition."""
    return {item["type"]: (item.get("status", ""), item.get("reason", "")) for item in status.get("conditions") or ()}
