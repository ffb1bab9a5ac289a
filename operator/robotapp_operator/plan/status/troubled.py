"""Instances of an app that need attention, worst first: one order for the status's list and for the reason of Ready.

Beside it the sentences about one instance that several conditions use.
"""

from enum import IntEnum
from typing import Any, Final, NamedTuple

from robotapp_api.model.names import ROBOT_END, Label, Reason
from robotapp_api.values.placement.given_up import GivenUpEdge
from robotapp_api.values.placement.round_trips import is_unreachable
from robotapp_api.values.quantities.duration import format_us, time_text
from robotapp_claims.rules.completion.endings import Ending
from robotapp_operator.plan.diff.master_restarts import MOST_RESTARTS
from robotapp_operator.plan.render.infrastructure import MASTER_ROLE
from robotapp_operator.plan.spec.text import clip, count, shown
from robotapp_operator.plan.status.facts import AppFacts, Grace, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeView

MAX_TROUBLED: Final = 10
MAX_TROUBLED_BYTES: Final = 1024
"""Of one message."""


class Rank(IntEnum):
    """How urgently an instance needs attention, most urgent first."""

    UNCLEAR = 0
    """Which node is the robot's is unknown."""
    FAILING = 1
    OFFLINE = 2
    NOT_READY = 3
    """The robot's node is not Ready, for a shorter time than `connectivity.grace`."""
    WAITING = 4
    """It waits for a node or a device."""
    DEVICE_LOST = 5
    """Its pods run, but one of their devices is gone."""
    UNCLEAR_BUT_READY = 6
    RESTART_NEEDED = 7
    HELPER_FAILING = 8
    """One of its two discovery servers fails, the other serves."""
    OVER_BUDGET = 9
    NONE = 10
    """It is ready, or still starting."""


_RANKS: Final = {
    Reason.ROBOT_NODE_UNCLEAR: Rank.UNCLEAR,
    Reason.ROBOT_OFFLINE: Rank.OFFLINE,
    Reason.ROBOT_NOT_READY: Rank.NOT_READY,
    Reason.UNSCHEDULABLE: Rank.WAITING,
    Reason.DEVICE_BUSY: Rank.WAITING,
}
"""Reasons of instances that are not ready; all others fail."""


class Trouble(NamedTuple):
    """An instance that needs attention. Sorts by rank, then by instance."""

    rank: Rank
    instance: str
    reason: Reason
    message: str


def troubled(facts: AppFacts) -> list[dict[str, Any]]:
    """The worst instances. Empty for a refused app, whose `Accepted` has the reason, and for a suspended one. Starting is no trouble."""
    if facts.problems or facts.app.suspended:
        return []
    found = sorted(trouble for instance in facts.instances if (trouble := trouble_of(instance)))
    return [
        {"instance": item.instance, "reason": item.reason.value, "message": clip(item.message, MAX_TROUBLED_BYTES)}
        for item in found[:MAX_TROUBLED]
    ]


def rank_of(instance: InstanceFacts) -> Rank:
    trouble = trouble_of(instance)
    return trouble.rank if trouble else Rank.NONE


def trouble_of(instance: InstanceFacts) -> Trouble | None:
    found = _not_ready(instance) or _though_ready(instance)
    if found is None:
        return None
    rank, reason, message = found
    return Trouble(rank, instance.name, reason, message)


def what_is_missing(instance: InstanceFacts) -> tuple[Reason, str] | None:
    """Why the instance as a whole is not ready, before its components are considered; None when nothing keeps it."""
    if instance.unclear and not instance.ready:
        return instance.unclear_reason, instance.unclear
    if instance.refusal or instance.trouble:
        return instance.refusal or instance.trouble
    if instance.ending is not None:
        return (
            None if instance.ending.is_success else (instance.ending.reason, explain_ending(instance, instance.ending))
        )
    if instance.ready:
        return None
    if instance.instance.missing:
        return Reason.ROBOT_OFFLINE, out_of_sight_text(instance.name)
    if instance.offline:
        node = instance.instance.node
        since = f" since {instance.offline_since}" if instance.offline_since else ""
        return (
            Reason.ROBOT_OFFLINE,
            f"node {node} of the robot is not Ready{since}: kubectl describe node {node} shows why",
        )
    if instance.grace:
        return Reason.ROBOT_NOT_READY, grace_text(instance.instance.node, instance.grace)
    return (Reason.DEVICE_BUSY, instance.busy) if instance.busy else None


def explain_ending(instance: InstanceFacts, ending: Ending) -> str:
    """Returns why an instance has failed, and what to do."""
    part = next((each for each in instance.components if each.name == ending.component), None)
    if part is not None:
        restarts = instance.attempt.restarts
        return f"{part.name}: {part.message}{f'; restarts before: {restarts}' if restarts else ''}"
    return (
        f"its jobs had not completed at {ending.time}, when their time was over (spec.completion.deadline): write a longer one, and run "
        f"them again with kubectl robotapp runs {instance.app_name} --failed"
    )


def explain_helpers(instance: InstanceFacts) -> tuple[Reason, str] | None:
    """Returns why a discovery server, router or master fails, None where none does for a stated reason."""
    failing = instance.failing_helpers
    if not failing:
        return None
    worst = failing[0].view
    names = [helper.part.name for helper in failing if helper.view.reason == worst.reason]
    text = f"{shown(names)}: {worst.message}"
    if worst.reason is Reason.IMAGE_PULL:
        text += "; spec.ros2.discovery.image, spec.ros1.image or the chart's helperImages name another image"
    prefix = "" if instance.ready else "its discovery or master is not ready: "
    return worst.reason or Reason.COMPONENTS_NOT_READY, prefix + text


def grace_text(node: str, grace: Grace) -> str:
    """What happens to an instance whose robot's node is not Ready, and when. Has absolute times, so that it does not get old."""
    return (
        f"node {node} of the robot is not Ready since {grace.since}: if it stays so, the instance is Offline at {grace.until} "
        f"(connectivity.grace, {grace.seconds:g} s); kubectl describe node {node} shows why"
    )


def out_of_sight_text(robot: str) -> str:
    """Why an instance whose robot has no node any more is Offline, what happens to it, and what the user can do."""
    return (
        f"robot {robot} is out of sight: no node with the label {Label.ROBOT}={robot} matches spec.robots. Its instance goes on for "
        "connectivity.grace, longer while many robots are missing; bring the node or its labels back, or change spec.robots"
    )


def cut_off_text(instance: InstanceFacts) -> str:
    """What the user must do about pods that know none of the present discovery servers, or that a new master does not know."""
    if any(helper.part.role == MASTER_ROLE for helper in instance.helpers):
        return f"the master was started anew since {shown(instance.cut_off)} started and has none of their topics, and restarts of nodes have reached {MOST_RESTARTS} within 24 hours; find out why the master ends, then delete these pods (kubectl delete pod NAME)"
    return f"all discovery servers were replaced since {shown(instance.cut_off)} started; delete these pods one by one (kubectl delete pod NAME)"


def lost_text(instance: InstanceFacts) -> str:
    """Which device is gone, and what happens to the pod."""
    first = instance.lost[0]
    more = f" and {len(instance.lost) - 1} more devices" if len(instance.lost) > 1 else ""
    text = f"{first.component}: {first}{more} is gone: plug it in again; onLoss decides what happens to the pod"
    return f"{text} ({instance.device_stays})" if instance.device_stays else text


def given_up_texts(instance: InstanceFacts) -> list[str]:
    """What the placement gave up, as the pods' annotations tell it, one sentence each. Both ends of an edge may tell of it, and an end that has moved since makes it history."""
    nodes = {component.name: component.nodes for component in instance.components}
    found: dict[tuple[str, ...], str] = {}
    for component in instance.components:
        for given in component.given_up:
            if given.tier:
                text = f"{component.name} runs on tier {given.tier} instead of {shown(given.instead_of)}"
                found.setdefault((component.name,), text)
            for edge in given.edges:
                if edge.peer == ROBOT_END or edge.nodes[1] in nodes.get(edge.peer, ()):
                    ends = sorted((component.name, edge.peer))
                    found.setdefault((edge.edge, *ends), _given_up_text(edge, component.name))
    return list(found.values())


def _given_up_text(edge: GivenUpEdge, name: str) -> str:
    takes = "is" if is_unreachable(edge.time_us) else "takes"
    time = f"{time_text(edge.time_us)} ({edge.source}, {edge.nodes[0]} to {edge.nodes[1]})"
    return f"{edge.edge} between {name} and {edge.peer} {takes} {time} instead of {format_us(edge.budget_us)}"


def edge_name(edge: EdgeView) -> str:
    """`/cmd_vel operator -> driver`."""
    return f"{edge.edge.topic} {edge.edge.from_} -> {edge.edge.to}"


def edge_text(edge: EdgeView) -> str:
    """`/cmd_vel operator -> driver 18ms of 30ms`."""
    time = "unknown" if edge.judged_us is None else time_text(edge.judged_us)
    return f"{edge_name(edge)} {time} of {time_text(edge.budget_us or 0)}"


def _not_ready(instance: InstanceFacts) -> tuple[Rank, Reason, str] | None:
    if missing := what_is_missing(instance):
        return _RANKS.get(missing[0], Rank.FAILING), *missing
    worst = instance.worst
    if worst is None or worst.reason is None:
        failure = explain_helpers(instance)
        return (_RANKS.get(failure[0], Rank.FAILING), *failure) if failure else None
    return _RANKS.get(worst.reason, Rank.FAILING), worst.reason, f"{worst.name}: {worst.message}"


def _though_ready(instance: InstanceFacts) -> tuple[Rank, Reason, str] | None:
    if instance.lost:
        return Rank.DEVICE_LOST, Reason.DEVICE_LOST, lost_text(instance)
    if instance.unclear:
        return Rank.UNCLEAR_BUT_READY, instance.unclear_reason, instance.unclear
    if instance.cut_off:
        return Rank.RESTART_NEEDED, Reason.RESTART_NEEDED, cut_off_text(instance)
    if failure := explain_helpers(instance):
        return Rank.HELPER_FAILING, *failure
    over = [edge for edge in instance.edges if edge.met is False]
    if over:
        return (
            Rank.OVER_BUDGET,
            Reason.BUDGET_EXCEEDED,
            f"{count(len(over), 'edge')} over budget, worst {edge_text(over[0])}",
        )
    return None
