"""The status of a RobotApp: phase, conditions, counts of its instances, and the values of the table's columns.

The state of one instance is in its RobotAppInstance (`instance_status`); all instances of a fleet would not fit into one
object.
"""

from collections.abc import Collection, Iterable
from typing import Any, Final

from robotapp_api.model.conditions import condition
from robotapp_api.model.names import Condition, Phase, Reason
from robotapp_api.values.quantities.duration import time_text
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.plan.spec.text import clip
from robotapp_operator.plan.status.conditions import (
    MAX_CONDITION_BYTES,
    conditions,
    held_by_newer,
    newer_templates,
    ready,
)
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeView
from robotapp_operator.plan.status.troubled import troubled

MAX_STATUS_BYTES: Final = 64 * 1024
"""No status of ours is larger, however large the app."""
MAX_TEXT: Final = 253
NO_ROBOTS: Final = "-"


def render_status(facts: AppFacts) -> dict[str, Any]:
    """The whole status as plain JSON. Equal facts give an equal status, so nothing is written at rest."""
    return {
        "observedGeneration": facts.app.generation,
        "phase": phase(facts).value,
        "conditions": conditions(facts),
        "instanceCounts": _counts(facts),
        "troubled": troubled(facts),
        "summary": _summary(facts),
        **written(completionTime=facts.completion_time),
    }


def same_status(wanted: dict[str, Any], have: Any) -> bool:
    """Equal in everything we write; fields of other writers do not count."""
    return all(have.get(key) == value for key, value in wanted.items()) if have else False


def unreadable_status(record: Record, now: str) -> dict[str, Any]:
    """Status of an object this version cannot read, so that its user learns why nothing happens."""
    text = "; ".join(map(str, record.problems)) or "the spec cannot be read"
    reason = record.problems[0].reason if record.problems else Reason.INVALID_SPEC
    verdicts = {Condition.ACCEPTED: "False", Condition.READY: "False", Condition.STALLED: "True"}
    all_invalid = [
        condition(
            kind.value,
            verdicts.get(kind, "Unknown"),
            reason.value,
            clip(text, MAX_CONDITION_BYTES),
            before=record.status.get("conditions") or (),
            generation=record.generation,
            now=now,
        )
        for kind in Condition
    ]
    return {
        "observedGeneration": record.generation,
        "phase": Phase.FAILED.value,
        "conditions": all_invalid,
        "instanceCounts": {"desired": 0, "ready": 0, "offline": 0, "completed": 0, "failed": 0},
        "troubled": [],
        "summary": {"ready": "0/0", "robots": NO_ROBOTS, "message": clip(text, MAX_TEXT)},
    }


def phase(facts: AppFacts) -> Phase:
    """Phase of the app, or of the one instance the facts are about.

    A robot out of reach makes its own instance Offline; the app is Offline where all its instances are, and else Degraded.
    """
    if facts.problems:
        return Phase.FAILED if facts.refused else Phase.PENDING
    if facts.app.suspended:
        pods = any(component.nodes for instance in facts.instances for component in instance.components)
        return Phase.STOPPING if pods else Phase.SUSPENDED
    if facts.ended:
        succeeded = all(instance.ending and instance.ending.is_success for instance in facts.instances)
        return Phase.COMPLETED if succeeded else Phase.FAILED
    order = (Phase.DEGRADED, Phase.PENDING, Phase.PLACING, Phase.RUNNING)
    found = {instance_phase(instance, str(facts.previous.get("phase", ""))) for instance in facts.begun}
    found -= {Phase.COMPLETED}  # the others decide
    if Phase.FAILED in found:
        return Phase.DEGRADED
    if Phase.OFFLINE in found:
        return Phase.OFFLINE if len(found) == 1 else Phase.DEGRADED
    return next((candidate for candidate in order if candidate in found), Phase.PENDING)


def instance_phase(instance: InstanceFacts, before: str) -> Phase:
    """Degraded is for what ran or fails for a stated reason; what merely starts is Placing."""
    if instance.ending is not None:
        return Phase.COMPLETED if instance.ending.is_success else Phase.FAILED
    if instance.offline:
        return Phase.OFFLINE
    if instance.ready:
        return Phase.RUNNING
    if instance.grace and instance.bound:
        return Phase.DEGRADED
    if any(component.reason is Reason.JOB_FAILED for component in instance.wanted):
        return Phase.DEGRADED  # it has run, and what waits for it waits for ever
    views = [*instance.components, *(helper.view for helper in instance.failing_helpers)]
    failing = [view for view in views if view.reason not in (None, Reason.UNSCHEDULABLE)]
    if instance.bound and (failing or before in (Phase.RUNNING, Phase.DEGRADED)):
        return Phase.DEGRADED
    if failing or instance.refusal or not instance.exists:
        return Phase.PENDING
    return Phase.PLACING


def _counts(facts: AppFacts) -> dict[str, int]:
    """A refused instance counts as failed, also while its pods of an earlier spec run on."""
    endings = [instance.ending for instance in facts.instances]
    return {
        "desired": len(facts.instances),
        "ready": sum(instance.ready for instance in facts.instances),
        "offline": sum(instance.offline for instance in facts.instances),
        "completed": sum(ending is not None and ending.is_success for ending in endings),
        "failed": sum(
            bool(facts.problems or instance.unclear or (instance.ending and not instance.ending.is_success))
            for instance in facts.instances
        ),
    }


def _summary(facts: AppFacts) -> dict[str, Any]:
    verdict = ready(facts)
    robots = f"{sum(i.ready for i in facts.instances)}/{len(facts.instances)}" if facts.app.spec.robots else NO_ROBOTS
    return written(
        ready=ready_text(facts),
        robots=robots,
        domain=domains_text({i.domain for i in facts.instances if i.domain is not None}),
        budget=budget_text(edge for instance in facts.instances for edge in instance.edges),
        devices=devices_text(facts.instances),
        nodes=nodes_text(facts.instances),
        rmw=facts.rmw,
        discovery=facts.discovery,
        message=clip(newer_templates(facts) if verdict.status == "True" else verdict.message, MAX_TEXT),
    )


def ready_text(facts: AppFacts) -> str:
    """`2/3` components; before there is any instance, those of the spec are what is wanted. `2/3 (1 held)` after a rollback:
    so many templates of a newer operator hold an edit back, and what is ready is not what the spec says. Of a sweep `37/200 done, 1 failed`.
    """
    if facts.app.spec.matrix is not None and not facts.alone:
        counts = _counts(facts)
        failed = f", {counts['failed']} failed" if counts["failed"] else ""
        return f"{counts['completed']}/{counts['desired']} done{failed}"
    parts = [component for instance in facts.instances for component in instance.wanted]
    parts += [part for instance in facts.instances if instance.ending for part in instance.components if part.is_job]
    held = len(held_by_newer(facts))
    planned = sum(component.replicas > 0 for component in facts.app.spec.components)
    up = f"{sum(component.ready for component in parts)}/{len(parts) or planned}"
    return f"{up} ({held} held)" if held else up


def devices_text(instances: Iterable[InstanceFacts]) -> str:
    pairs = [(instance.devices_held, instance.devices_wanted) for instance in instances]
    wanted = sum(pair[1] for pair in pairs)
    return f"{sum(pair[0] for pair in pairs)}/{wanted}" if wanted else ""


def nodes_text(instances: Iterable[InstanceFacts]) -> str:
    nodes = {node for instance in instances for component in instance.components for node in component.nodes}
    return clip(",".join(sorted(nodes)), MAX_TEXT)


def budget_text(edges: Iterable[EdgeView]) -> str:
    """`18/30ms` of the edge that uses most of its budget: the percentile the budget is about, as BudgetMet judges it."""
    worst = max((edge for edge in edges if edge.budget_us is not None), key=lambda edge: edge.use, default=None)
    if worst is None:
        return ""
    time = "?" if worst.judged_us is None else time_text(worst.judged_us).removesuffix("ms")
    return f"{time}/{time_text(worst.budget_us or 0)}"[:32]


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


def written(**fields: Any) -> dict[str, Any]:
    """The fields that are not empty."""
    return {name: value for name, value in fields.items() if value is not None and value not in ("", [])}
