"""A robot, three servers, and an app whose planner is on a server that has become too far from the robot."""

from collections.abc import Mapping
from typing import Any

import msgspec
from tests.support.scheduling import Clock, app_object, chain, make_core, make_node, member_pod, telemetry

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import Member
from robotapp_scheduler.core.robotics.edge_times import PlacedComponent, part_of

COMPONENTS = ({"name": "driver", "runsOn": ["Robot"]}, {"name": "planner"})
MEMBER = Member("app-1", "amr", "planner")
RTT_MS = {"e1": 60.0, "e2": 8.0, "e3": 15.0}


def edge(start: str, end: str, budget: str = "20ms", **latency: Any) -> dict[str, Any]:
    return {"topic": f"/{start}", "from": start, "to": end, "latency": {"budget": budget, **latency}}


def robot_and_servers(
    *more: Node, clock: Clock | None = None, edges: list[dict[str, Any]] | None = None, **spec: Any
) -> SchedulerCore:
    """Driver on the robot, planner on e1. e2 is near; e3 is within the budget, but with a small margin."""
    core = make_core(
        make_node("amr", labels={str(Label.ROBOT): "amr"}, cpu="1"),
        *(make_node(name, cpu="2") for name in RTT_MS),
        *more,
        clock=clock,
    )
    components = spec.pop("components", COMPONENTS)
    core.cluster.apply_app(app_object(*components, edges=edges or [edge("planner", "driver")], **spec))
    for component in components:
        for owned in chain(str(component["name"])):
            core.cluster.apply_owner(owned)
    measure(core)
    core.cluster.apply_pod(placed("driver", "amr"))
    core.cluster.apply_pod(placed("planner", "e1"))
    return core


def placed(component: str, node: str, *, uid: str = "", **fields: Any) -> Pod:
    where = {"nodeSelector": {"kubernetes.io/hostname": node}} if component == "driver" else {}
    return member_pod(component, instance="amr", uid=uid or component, node=node, **{"cpu": "1", **where, **fields})


def measure(core: SchedulerCore, rtt_ms: Mapping[str, float] | None = None, *, seq: int | None = None) -> None:
    """What the robot's agent reports; its times to the servers are those of `RTT_MS` unless given."""
    core.cluster.apply_telemetry(telemetry("amr", rtt_ms={**RTT_MS, **(rtt_ms or {})}, seq=seq))


def planner(core: SchedulerCore) -> PlacedComponent:
    app = core.cluster.apps.app(MEMBER.app_uid)
    assert app is not None
    found = part_of(app, MEMBER, core.cluster.apps)
    assert found is not None
    return found


def annotate(core: SchedulerCore, pod: Pod, text: str | None) -> None:
    """The pod as the watch shows it after its annotation was written."""
    meta = msgspec.structs.replace(pod.metadata, annotations={} if text is None else {Annotation.BETTER_NODE: text})
    core.cluster.apply_pod(msgspec.structs.replace(pod, metadata=meta))
