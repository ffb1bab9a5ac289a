"""The order in which instances without a domain try to get one: as many at a time as ids are free.

Of five hundred instances that wait for a full pool one can get an id that becomes free; if all tried, each such id would cost
the API server thousands of requests.
"""

from collections.abc import Iterator

from robotapp_api.claims.domain import pool_ids
from robotapp_api.model.names import Reason
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache

Waiting = tuple[str, str]
"""(uid of the app, instance)."""


class Line:
    """Decides by the caches. An instance that was chosen in vain only loses its turn, and the next one is chosen soon."""

    def __init__(self, cache: Cache, memory: ReconcileState) -> None:
        self._cache = cache
        self._memory = memory
        self._order: dict[str, list[Waiting]] = {}
        """By pool: the instances in their order. One that was chosen, or waits again after a while, goes to the end."""

    def __repr__(self) -> str:
        return f"<Line of {len(self._memory.without_domain())}>"

    def next(self, pool: str) -> tuple[list[Waiting], bool]:
        """The instances that try now, and whether others go on waiting although ids are free."""
        in_line, others = list[Waiting](), list[Waiting]()
        for uid, robot, app in self._waiting(pool):
            (in_line if self._takes_any(app, uid, robot) else others).append((uid, robot))
        free = self._free(pool)
        if free is None:
            return others + in_line, False
        chosen = self._turn(pool, in_line, free)
        return others + chosen, 0 < len(chosen) < len(in_line)

    def _waiting(self, pool: str) -> Iterator[tuple[str, str, App]]:
        for uid, robot in self._memory.without_domain():
            record = self._cache.apps.get(uid)
            app = record.app if record else None
            if app and (app.pool == pool or app.share_with):
                yield uid, robot, app

    def _takes_any(self, app: App, uid: str, robot: str) -> bool:
        """Whether the instance waits for nothing but a free id. Instances with another refusal try each time."""
        outcome = self._memory.outcome(uid, robot)
        exhausted = outcome is not None and outcome.reason is Reason.DOMAIN_EXHAUSTED
        shared = app.spec.ros2 is not None and app.spec.ros2.isolation != "Domain"
        return exhausted and not shared and not app.share_with and app.requested_domain is None

    def _free(self, pool: str) -> int | None:
        """Ids of the pool without a claim; None where they are counted by zone or node."""
        found = self._cache.pools.get(pool)
        if found is None or found.spec.scope != "Cluster":
            return None
        things = (claim.spec.domain for claim in self._cache.all_claims())
        return len(pool_ids(found) - {thing.id for thing in things if thing is not None and thing.pool == pool})

    def _turn(self, pool: str, in_line: list[Waiting], free: int) -> list[Waiting]:
        waiting = set(in_line)
        before = dict.fromkeys(each for each in self._order.get(pool, ()) if each in waiting)
        order = list(before | dict.fromkeys(in_line))
        chosen = order[:free]
        self._order[pool] = [*order[free:], *chosen]
        return chosen
