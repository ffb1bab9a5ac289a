"""May a component of an instance be moved because an edge of it exceeds its budget, and where to?

`placement.reschedule.when: BudgetExceeded` asks for it. The scheduler proposes a node (`robotics.io/better-node` on the pod),
because it alone knows where there is room; whether the app as a whole gains by it is judged here once more, by what is
measured now.
"""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import datetime
from typing import NamedTuple

from robotapp_api.model.app.component import Component
from robotapp_api.values.placement.better_node import MOST_USE, BetterNode, edge_to, is_gain, topic_of
from robotapp_api.values.placement.round_trips import Figures
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_api.values.quantities.duration import time_text
from robotapp_operator.plan.moves.move_record import Limits, MoveRecord
from robotapp_operator.plan.spec.desired import NEVER, App
from robotapp_operator.plan.status.latency import EdgeKey, EdgeView
from robotapp_operator.plan.status.troubled import edge_name

Between = Callable[[str, str], Figures | None]
"""The measured round trip between two nodes, None when it is unknown."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Running:
    """The only pod of a component, bound and not ending. `better`: the scheduler's proposal, with "" or what is wrong with it."""

    component: Component
    pod: str
    node: str
    record: MoveRecord | None
    better: BetterNode | None = None
    unreadable: str = ""


class Move(NamedTuple):
    """Evict this pod. `counted`: the record has it already. `why` names the edge, before and after."""

    component: str
    pod: str
    before: str
    after: str
    why: str
    counted: bool = False


class Stays(NamedTuple):
    """Nothing is moved for the sake of this component. `why` is part of a sentence, "" when there is nothing to tell."""

    component: str
    why: str


def reschedule(
    app: App,
    edges: Sequence[EdgeView],
    *,
    over: Collection[EdgeKey],
    running: Mapping[str, Running],
    between: Between,
    unusable: Callable[[str], str],
    now: datetime,
) -> Move | Stays | None:
    """What to do about the worst edge of an instance that can be helped; None when no required edge is over its budget.

    edges: as measured now. over: those that have been over their budget for `placement.reschedule.for`. running: components
    with one settled pod. unusable: why a node takes no pod, "" when it does. One component moves at a time: what the others
    gain by it shows afterwards.
    """
    late = [edge for edge in edges if edge.key in over and edge.met is False and _required(edge)]
    first: Stays | None = None
    for edge in sorted(late, key=lambda one: (-one.use, one.key)):
        for end in (edge.edge.from_, edge.edge.to):
            component = next((one for one in app.spec.components if one.name == end), None)
            if component is None:
                continue
            found = _of_component(
                app, component, edge, edges, running=running, between=between, unusable=unusable, now=now
            )
            if isinstance(found, Move):
                return found
            if first is None or not first.why:
                first = found
    return first


def _of_component(
    app: App,
    component: Component,
    edge: EdgeView,
    edges: Sequence[EdgeView],
    *,
    running: Mapping[str, Running],
    between: Between,
    unusable: Callable[[str], str],
    now: datetime,
) -> Move | Stays:
    pod, name = running.get(component.name), component.name
    if is_tied_to_robot(component) or component.replicas != 1 or pod is None:
        return Stays(name, "")
    if pod.unreadable:
        return Stays(name, f"annotation robotics.io/better-node of its pod {pod.unreadable}")
    better = pod.better
    if better is None or better.expires <= now or better.node == pod.node:
        return Stays(name, "")
    about = _is_about(better, edge, name)
    place = (
        f"{name} would have {time_text(better.after_us)} on {better.node}"
        if about
        else f"{better.node} is proposed for {name}"
    )
    if app.spec.placement.reschedule.when == NEVER:
        return Stays(name, f"{place}, but placement.reschedule.when is Never")
    if problem := unusable(better.node):
        return Stays(name, f"{place}, but that node {problem}")
    after_us = _after_us(edge, name, better, between)
    if after_us is None:
        return Stays(name, f"{place}, but the time of {edge_name(edge)} there is not measured")
    if problem := _no_gain(edge, edges, component=name, node=better.node, after_us=after_us, between=between):
        return Stays(name, f"{place}, but {problem}")
    if pod.record is None:
        return Stays(name, f"{place}, but annotation robotics.io/moves of its Deployment cannot be read: remove it")
    if problem := pod.record.why_not(pod.pod, limits_of(app), now):
        return Stays(name, f"{place}, but {problem}")
    why = f"{edge_name(edge)} {_time(edge)} of {time_text(edge.budget_us or 0)} before, {time_text(after_us)} expected"
    return Move(name, pod.pod, pod.node, better.node, why, pod.record.counts(pod.pod, now))


def moved_text(move: Move, node: str) -> str:
    """The note of the event about a move whose new pod is on `node`."""
    if node == move.before:
        return f"{move.component} was evicted from {move.before} and came back, {move.after} was proposed: {move.why}"
    other = "" if node == move.after else f" ({move.after} was proposed)"
    return f"{move.component} moved from {move.before} to {node}{other}: {move.why}"


def is_tied_to_robot(component: Component) -> bool:
    """Such a component is never moved: nowhere else would be its robot."""
    return tuple(component.runs_on) == (ROBOT,)


def limits_of(app: App) -> Limits:
    return Limits(cooldown=app.cooldown, max_per_day=app.spec.placement.reschedule.max_per_day)


def _required(edge: EdgeView) -> bool:
    return edge.edge.latency is not None and edge.edge.latency.enforce == "Required"


def _time(edge: EdgeView) -> str:
    return "?" if edge.judged_us is None else time_text(edge.judged_us)


def _no_gain(
    edge: EdgeView, edges: Sequence[EdgeView], *, component: str, node: str, after_us: float, between: Between
) -> str:
    """Why the move gains too little, or makes another edge of the app worse; "" when it is worth it.

    No measured time is in the sentence: a status that followed each measurement would be written for ever, and two operators
    would overwrite each other's.
    """
    if not is_gain(before_us=edge.judged_us or 0, after_us=after_us, budget_us=edge.budget_us or 0):
        most_us = MOST_USE * (edge.budget_us or 0)
        return f"that is no gain as measured now: {time_text(most_us)} or less, and a fifth less than where it is, would be"
    for other in edges:
        there_us = _judged_there(other, component, node, between)
        if other.budget_us is None or there_us is None or there_us <= other.budget_us:
            continue
        if other.met is not False or there_us > (other.judged_us or 0):
            return f"{edge_name(other)} would be over its budget of {time_text(other.budget_us)} there"
    return ""


def _after_us(edge: EdgeView, component: str, better: BetterNode, between: Between) -> float | None:
    """The time of an edge on the proposed node: as measured now, else that of the proposal if it is about this edge."""
    measured_us = _judged_there(edge, component, better.node, between)
    if measured_us is None and _is_about(better, edge, component):
        return better.after_us
    return measured_us


def _is_about(better: BetterNode, edge: EdgeView, component: str) -> bool:
    """Is the proposal for the component made for the sake of this edge?"""
    peer = edge.edge.to if edge.edge.from_ == component else edge.edge.from_
    return better.edge == edge_to(topic_of(edge.edge.kind, edge.edge.topic), peer)


def _judged_there(edge: EdgeView, component: str, node: str, between: Between) -> float | None:
    """The time of an edge with the component on `node`; None for edges of other components, and for pairs that are not measured."""
    ends = [edge.edge.from_, edge.edge.to]
    if component not in ends:
        return None
    other = edge.nodes[1 - ends.index(component)]
    found = between(node, other) if other else None
    return found.of(edge.edge.latency.percentile if edge.edge.latency else 95) if found else None
