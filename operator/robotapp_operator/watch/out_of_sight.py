"""Robots out of sight (without a node that matches): how long their instances are kept.

A Node that is deleted and joins again, or a label that is missing for a while, ends no instance. An instance ends for want of a
node only after `connectivity.grace`, counted anew by every process, and not while too many robots are missing.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

from robotapp_api.model.app.robots import Robots
from robotapp_api.model.names import Label
from robotapp_api.values.selector import matches_requirement
from robotapp_operator.plan.spec.desired import App

MANY_MISSING_S: Final = 10.0
"""Interval of checks of an instance whose grace is over while too many robots are missing."""
_NOTHING: Final = frozenset[str]()


class Requirement(NamedTuple):
    """One requirement on a node's labels."""

    key: str
    operator: str
    values: tuple[str, ...]


def _selected(robot: str, robots: Robots | None, before: "Missing") -> bool:
    """Does spec.robots still select a robot that has no node? What it wanted before of other labels than the robot's, its node had."""
    if before.robots == robots:
        return robot not in before.ended
    if before.robots is None or robots is None or before.robots.assignment != robots.assignment:
        return False
    had = set(_requirements(before.robots))
    return all(
        matches_requirement(wanted, robot) if wanted.key == Label.ROBOT else wanted in had
        for wanted in _requirements(robots)
    )


def _requirements(robots: Robots) -> Iterator[Requirement]:
    selector = robots.node_selector
    for key, value in selector.match_labels.items():
        yield Requirement(key, "In", (value,))
    for one in selector.match_expressions:
        yield Requirement(one.key, one.operator, one.values)


@dataclasses.dataclass(frozen=True, slots=True)
class Missing:
    """Missing robots of one app. since: when each was first missing. ended: robots that spec.robots no longer selects."""

    robots: Robots | None
    since: Mapping[str, float] = dataclasses.field(default_factory=dict)
    ended: frozenset[str] = _NOTHING


class OutOfSight:
    """Missing robots by app uid. Starts empty: a robot that is missing when the process starts gets the whole grace again."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._apps: dict[str, Missing] = {}

    def __repr__(self) -> str:
        return f"<OutOfSight: {sum(len(missing.since) for missing in self._apps.values())} robots missing>"

    def kept(self, app: App, missing: frozenset[str], *, too_many: Callable[[], bool]) -> frozenset[str]:
        """Of the robots that are `missing` now, those whose instances are kept.

        A change of spec.robots by the user that no longer selects a robot ends its instance at once. too_many: whether no instance may end because of its
        node now; called only when one is about to.
        """
        robots, before = app.spec.robots, self._apps.get(app.uid)
        if not missing:
            if before is None or before.robots is not robots or before.since or before.ended:
                self._apps[app.uid] = Missing(robots)
            return _NOTHING
        before = before or Missing(robots)
        ended = frozenset(robot for robot in missing if not _selected(robot, robots, before))
        now = self._clock()
        since = {robot: before.since.get(robot, now) for robot in missing - ended}
        self._apps[app.uid] = Missing(robots, since, ended)
        over = {robot for robot, began in since.items() if now - began >= app.grace_s}
        return frozenset(since) if not over or too_many() else frozenset(since.keys() - over)

    def look_again_s(self, app: App) -> float | None:
        """Seconds until `kept` may return something else without an event; None when no robot is missing."""
        missing = self._apps.get(app.uid)
        if missing is None or not missing.since:
            return None
        left = app.grace_s - (self._clock() - min(missing.since.values()))
        return left if left > 0 else MANY_MISSING_S

    def forget(self, uid: str) -> None:
        self._apps.pop(uid, None)
