"""Instances of an app that need attention, worst first."""

from typing import Any, Final, NamedTuple

from robotapp_api.model.names import Reason
from robotapp_operator.plan.conditions import cut_off_text, edge_text, what_is_missing
from robotapp_operator.plan.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.text import clip

MAX_TROUBLED: Final = 10
MAX_MESSAGE: Final = 1024
"""Bytes of one message."""

_RANKS: Final = {Reason.ROBOT_NODE_UNCLEAR: 0, Reason.ROBOT_OFFLINE: 2, Reason.UNSCHEDULABLE: 3, Reason.DEVICE_BUSY: 3}
"""Instances that wait for a robot, a node or a device come after those that fail."""
_FAILS: Final = 1


class Trouble(NamedTuple):
    """Sorted by how bad it is, then by instance."""

    rank: int
    instance: str
    reason: Reason
    message: str


def troubled(facts: AppFacts) -> list[dict[str, Any]]:
    """The worst instances. Empty for a refused app, whose `Accepted` has the reason, and for a suspended one. Starting is no trouble."""
    if facts.problems or facts.app.spec.suspend:
        return []
    found = sorted(trouble for instance in facts.instances if (trouble := trouble_of(instance)))
    return [
        {"instance": item.instance, "reason": item.reason.value, "message": clip(item.message, MAX_MESSAGE)}
        for item in found[:MAX_TROUBLED]
    ]


def trouble_of(instance: InstanceFacts) -> Trouble | None:
    found = _not_ready(instance) or _though_ready(instance)
    if found is None:
        return None
    rank, reason, message = found
    return Trouble(rank, instance.name, reason, message)


def _not_ready(instance: InstanceFacts) -> tuple[int, Reason, str] | None:
    if missing := what_is_missing(instance):
        return _RANKS.get(missing[0], _FAILS), *missing
    worst = instance.worst
    if worst is None or worst.reason is None:
        return None
    return _RANKS.get(worst.reason, _FAILS), worst.reason, f"{worst.name}: {worst.message}"


def _though_ready(instance: InstanceFacts) -> tuple[int, Reason, str] | None:
    if instance.unclear:
        return 4, Reason.ROBOT_NODE_UNCLEAR, instance.unclear
    if instance.cut_off:
        return 5, Reason.RESTART_NEEDED, cut_off_text(instance)
    over = [edge for edge in instance.edges if edge.met is False]
    if over:
        return 6, Reason.BUDGET_EXCEEDED, f"{len(over)} edges are over budget, worst {edge_text(over[0])}"
    return None
