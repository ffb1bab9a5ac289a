"""The status of a RobotAppInstance: what is observed of one instance, within a size that does not depend on the app."""

from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.values.placement.round_trips import is_unreachable
from robotapp_api.values.quantities.duration import time_text
from robotapp_operator.plan.diff.attempts import RESTARTS_FIELD, render_attempt
from robotapp_operator.plan.spec.text import clip, stored_bytes
from robotapp_operator.plan.status.components import HelperView
from robotapp_operator.plan.status.conditions import MAX_BRIEF_BYTES, conditions, ready
from robotapp_operator.plan.status.facts import AppFacts
from robotapp_operator.plan.status.latency import EdgeView
from robotapp_operator.plan.status.status import (
    MAX_STATUS_BYTES,
    MAX_TEXT,
    budget_text,
    devices_text,
    nodes_text,
    phase,
    ready_text,
    written,
)

MAX_EDGES: Final = 64
MAX_CLAIMS: Final = 64
MAX_HELPERS: Final = 4
OURS: Final = (
    "phase",
    "conditions",
    "summary",
    "domain",
    "components",
    "helpers",
    "links",
    "edges",
    "edgesOmitted",
    "claims",
    "completionTime",
    RESTARTS_FIELD,
)
"""What the operator writes, and `moves` once there is one."""


def render_instance(facts: AppFacts) -> dict[str, Any]:
    """The status as plain JSON. `facts` are those of one instance (`of_instance`); equal facts give an equal status.

    Edges get the room that conditions and components leave.
    """
    (instance,) = facts.instances
    verdict = ready(facts)
    components = sorted(instance.components, key=lambda component: (-component.badness, component.name))
    status: dict[str, Any] = {
        "phase": phase(facts).value,
        "conditions": conditions(facts),
        "summary": written(
            ready=ready_text(facts),
            budget=budget_text(instance.edges),
            devices=devices_text(facts.instances),
            nodes=nodes_text(facts.instances),
            message="" if verdict.status == "True" else clip(verdict.message, MAX_BRIEF_BYTES),
        ),
        "components": [
            {
                "name": component.name,
                "ready": component.ready,
                "restarts": component.restarts,
                **({"completed": True} if component.completed else {}),
                **written(node=component.node, message=clip(component.message, MAX_BRIEF_BYTES)),
            }
            for component in components
        ],
        **written(
            helpers=[_render_helper(helper) for helper in instance.helpers[:MAX_HELPERS]],
            domain=instance.domain,
            completionTime=instance.ending.time if instance.ending else None,
            restarts=render_attempt(instance.attempt),
            links=[link._asdict() for link in instance.links],
            claims=list(instance.claims[:MAX_CLAIMS]),
            moves=[{"component": name, "times": list(times)} for name, times in instance.moves],
        ),
    }
    # A list that is not ours stays where it is.
    kept = 0 if instance.moves else stored_bytes(facts.previous.get("moves") or [])
    room = MAX_STATUS_BYTES - stored_bytes(status) - kept - len(',"edges":[],"edgesOmitted":256')
    edges = _fitting([_edge(edge) for edge in instance.edges[:MAX_EDGES]], room)
    return status | written(edges=edges, edgesOmitted=(len(instance.edges) - len(edges)) or None)


def same_instance_status(wanted: Mapping[str, Any], have: Mapping[str, Any]) -> bool:
    fields = (*OURS, "moves") if "moves" in wanted else OURS
    return all(wanted.get(field) == have.get(field) for field in fields)


def without_times(status: Mapping[str, Any]) -> dict[str, Any]:
    """The status as it would be at any other time: a condition that is about to change has the present one each time it is rendered."""
    undated = [{key: item[key] for key in item if key != "lastTransitionTime"} for item in status["conditions"]]
    return {**status, "conditions": undated}


def _fitting(edges: list[dict[str, Any]], room: int) -> list[dict[str, Any]]:
    for index, edge in enumerate(edges):
        room -= stored_bytes(edge) + len(",")
        if room < 0:
            return edges[:index]
    return edges


def _render_helper(helper: HelperView) -> dict[str, Any]:
    view = helper.view
    return {
        "name": helper.part.name,
        "image": helper.part.image[:MAX_TEXT],
        "ready": view.ready,
        "restarts": view.restarts,
        **written(node=view.node, message=clip(view.message, MAX_BRIEF_BYTES)),
    }


def _edge(edge: EdgeView) -> dict[str, Any]:
    return {
        "kind": edge.edge.kind,
        "topic": edge.edge.topic,
        "from": edge.edge.from_,
        "to": edge.edge.to,
        "measured": edge.measured,
        **written(
            nodes=[node for node in edge.nodes if node],
            budget=edge.edge.latency.budget if edge.edge.latency else None,
            p95=None if edge.p95_us is None or is_unreachable(edge.p95_us) else time_text(edge.p95_us),
            met=edge.met,
        ),
    }
