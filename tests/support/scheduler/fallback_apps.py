"""An app with a Preferred budget, nodes at known distances, and a time of day that moves when told."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Final

import msgspec
from tests.support.scheduler.pod_groups import arrive
from tests.support.scheduling import Clock, app_object, chain, make_core, make_node, member_pod, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.queue.queued_pod_info import Rejection

START: Final = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
ROBOT: Final = "amr"


class Day:
    """The time of day."""

    def __init__(self) -> None:
        self.now = START

    def __call__(self) -> datetime:
        return self.now

    def forward(self, seconds: float) -> None:
        self.now += timedelta(seconds=seconds)


def tier_node(name: str, tier: str, **fields: Any) -> Node:
    labels = {str(Label.TIER): tier} | ({str(Label.ROBOT): name} if tier == "robot" else {})
    return make_node(name, labels=labels, **fields)


def core_of(nodes: Sequence[Node], rtt_ms: Mapping[str, Mapping[str, float]]) -> tuple[SchedulerCore, Day, Clock]:
    """`rtt_ms`: from a node to others."""
    clock, day = Clock(), Day()
    core = make_core(*nodes, clock=clock)
    core.cluster.now = day
    for name, peers in rtt_ms.items():
        core.cluster.apply_telemetry(telemetry(name, rtt_ms=peers))
    return core, day, clock


def give_app(
    core: SchedulerCore, *components: Mapping[str, Any], edges: Sequence[Mapping[str, Any]], **placement: Any
) -> None:
    spec = {"placement": placement} if placement else {}
    core.cluster.apply_app(app_object(*map(dict, components), edges=list(map(dict, edges)), **spec))
    for component in components:
        for owned in chain(str(component["name"])):
            core.cluster.apply_owner(owned)


def prefer(start: str, end: str, budget: str = "30ms", enforce: str = "Preferred") -> dict[str, Any]:
    return {"topic": f"/{start}", "from": start, "to": end, "latency": {"budget": budget, "enforce": enforce}}


def made(pod: Pod, day: Day) -> Pod:
    """The pod as made now, with the precision of the API server."""
    at = day.now.replace(microsecond=0).isoformat().replace("+00:00", "Z")
    return msgspec.structs.replace(pod, metadata=msgspec.structs.replace(pod.metadata, creation_timestamp=at))


def give_pod(core: SchedulerCore, day: Day, component: str, **fields: Any) -> None:
    arrive(core, made(member_pod(component, instance=ROBOT, **fields), day))


def decide(core: SchedulerCore) -> dict[str, ScheduleResult]:
    """Attempts of everything that is active, by component; pods without a node wait again."""
    found: dict[str, ScheduleResult] = {}
    core.queue.tick()
    while batch := core.queue.pop():
        for decision in core.schedule(batch):
            found[decision.pod.labels[Label.COMPONENT]] = decision
            assert decision.queued is not None
            if decision.placed:
                core.queue.done(decision.pod.uid)
            else:
                core.queue.requeue(decision.queued, Rejection(decision.rejected_by))
    return found


def places(found: Mapping[str, ScheduleResult]) -> dict[str, str | None]:
    return {name: decision.node for name, decision in found.items()}
