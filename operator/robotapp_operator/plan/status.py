"""The status to write: phase, conditions, instances worst first, and one line for the table."""

import json
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final

from robotapp_api.model.names import Phase, Reason
from robotapp_api.values.duration import format_ms, parse_us
from robotapp_operator.plan.conditions import Verdict, conditions, ready
from robotapp_operator.plan.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.latency import EdgeView, steady_p95

MAX_INSTANCES: Final = 128
MAX_EDGES: Final = 64
MAX_CLAIMS: Final = 64
MAX_DETAIL_BYTES: Final = 192 * 1024
"""Of the 256 KiB a status may have; conditions and summary take the rest."""


def render_status(facts: AppFacts) -> dict[str, Any]:
    """The whole status as plain JSON. Equal facts give an equal status, so nothing is written at rest."""
    shown, omitted = _details(facts)
    status: dict[str, Any] = {
        "observedGeneration": facts.app.generation,
        "phase": phase(facts).value,
        "conditions": conditions(facts),
        "instances": shown,
        "summary": _summary(facts, shown, omitted),
    }
    if facts.previous.get("moves"):
        status["moves"] = facts.previous["moves"]  # a record, not ours to compute
    return status


def phase(facts: AppFacts) -> Phase:
    if facts.problems:
        return Phase.FAILED
    if facts.app.spec.suspend:
        pods = any(component.nodes for instance in facts.instances for component in instance.components)
        return Phase.STOPPING if pods else Phase.SUSPENDED
    order = (Phase.OFFLINE, Phase.DEGRADED, Phase.PENDING, Phase.PLACING, Phase.RUNNING)
    found = {instance_phase(instance, str(facts.previous.get("phase", ""))) for instance in facts.instances}
    return next((candidate for candidate in order if candidate in found), Phase.PENDING)


def instance_phase(instance: InstanceFacts, before: str) -> Phase:
    """Degraded is for what ran or fails for a stated reason; what merely starts is Placing."""
    if not instance.robot_online:
        return Phase.OFFLINE
    if instance.ready:
        return Phase.RUNNING
    failing = [c for c in instance.components if c.reason not in (None, Reason.UNSCHEDULABLE)]
    if instance.bound and (failing or before in (Phase.RUNNING, Phase.DEGRADED)):
        return Phase.DEGRADED
    if failing or instance.refusal or not any(component.exists for component in instance.components):
        return Phase.PENDING
    return Phase.PLACING


def _details(facts: AppFacts) -> tuple[list[dict[str, Any]], int]:
    """Worst instances first, as many as fit."""
    before = {item.get("robot", ""): item for item in _list(facts.previous.get("instances"))}
    ordered = sorted(facts.instances, key=lambda instance: (_goodness(instance), instance.name))
    shown: list[dict[str, Any]] = []
    size = 0
    for instance in ordered[:MAX_INSTANCES]:
        item = _instance(facts, instance, before.get(instance.name, {}))
        size += len(json.dumps(item))
        if size > MAX_DETAIL_BYTES:
            break
        shown.append(item)
    return shown, len(ordered) - len(shown)


def _goodness(instance: InstanceFacts) -> tuple[bool, bool]:
    return (instance.ready, not any(edge.met is False for edge in instance.edges))


def _instance(facts: AppFacts, instance: InstanceFacts, before: Mapping[str, Any]) -> dict[str, Any]:
    old_edges = {(edge["topic"], edge["from"], edge["to"]): edge for edge in _list(before.get("edges"))}
    components = sorted(instance.components, key=lambda component: (-component.badness, component.name))
    return {
        "robot": instance.name,
        **_written(domain=instance.domain),
        "ready": instance.ready,
        "phase": instance_phase(instance, str(before.get("phase", ""))).value,
        "components": [
            {
                "name": component.name,
                "ready": component.ready,
                "restarts": component.restarts,
                **_written(node=component.node, message=component.message),
            }
            for component in components
        ],
        **_written(
            edges=[_edge(edge, old_edges, rested=facts.latency_rested) for edge in instance.edges[:MAX_EDGES]],
            claims=list(instance.claims[:MAX_CLAIMS]),
        ),
    }


def _edge(edge: EdgeView, before: Mapping[tuple[str, str, str], Mapping[str, Any]], *, rested: bool) -> dict[str, Any]:
    old = before.get((edge.edge.topic, edge.edge.from_, edge.edge.to), {})
    moved = old.get("nodes", []) != [node for node in edge.nodes if node] or old.get("met") != edge.met
    previous_us = parse_us(old["p95"]) if "p95" in old else None
    p95_us = steady_p95(previous_us, edge.p95_us, verdict_changed=moved, rested=rested)
    return {
        "topic": edge.edge.topic,
        "from": edge.edge.from_,
        "to": edge.edge.to,
        "measured": edge.measured,
        **_written(
            nodes=[node for node in edge.nodes if node],
            budget=edge.edge.latency.budget if edge.edge.latency else None,
            p95=None if p95_us is None else format_ms(p95_us / 1000),
            met=edge.met,
        ),
    }


def _summary(facts: AppFacts, shown: list[dict[str, Any]], omitted: int) -> dict[str, Any]:
    parts = [component for instance in facts.instances for component in instance.components]
    up = sum(component.ready for component in parts)
    wanted = sum(instance.devices_wanted for instance in facts.instances)
    held = sum(instance.devices_held for instance in facts.instances)
    verdict: Verdict = ready(facts)
    desired = len(parts) or len(facts.app.spec.components)
    robots = f"{sum(i.ready for i in facts.instances)}/{len(facts.instances)}" if facts.app.spec.robots else ""
    return _written(
        ready=f"{up}/{desired}",
        readyComponents=up,
        desiredComponents=desired,
        robots=robots,
        domain=domains_text({i.domain for i in facts.instances if i.domain is not None}),
        budget=_budget(shown),
        devices=f"{held}/{wanted}" if wanted else "",
        nodes=",".join(sorted({node for component in parts for node in component.nodes}))[:253],
        rmw=facts.rmw,
        discovery=facts.discovery,
        message="" if verdict.status == "True" else verdict.message[:253],
        omitted=omitted or None,
    )


def _budget(shown: Iterable[Mapping[str, Any]]) -> str:
    """`18/30ms` of the edge that uses most of its budget, from the published figures."""
    worst, text = -1.0, ""
    for instance in shown:
        for edge in instance.get("edges", ()):
            if "budget" not in edge:
                continue
            budget_us = parse_us(edge["budget"])
            p95_us = parse_us(edge["p95"]) if "p95" in edge else None
            use = -0.5 if p95_us is None else p95_us / budget_us
            if use > worst:
                time = "?" if p95_us is None else format_ms(p95_us / 1000).removesuffix("ms")
                worst, text = use, f"{time}/{format_ms(budget_us / 1000)}"
    return text[:32]


def domains_text(ids: Collection[int], limit: int = 63) -> str:
    """Ranges of `ids`; where they do not fit, the first ones and how many there are."""
    text = ranges(ids)
    if len(text) <= limit:
        return text
    count = f",… ({len(ids)})"
    return text[: limit - len(count)].rpartition(",")[0] + count


def ranges(ids: Iterable[int]) -> str:
    """`7-9,12` for 7, 8, 9 and 12."""
    parts: list[list[int]] = []
    for number in sorted(ids):
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ",".join(str(part[0]) if len(part) == 1 else f"{part[0]}-{part[-1]}" for part in parts)


def _list(value: object) -> list[dict[str, Any]]:
    return [item for item in value if isinstance(item, dict)] if isinstance(value, list) else []


def _written(**fields: Any) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None and value not in ("", [])}
