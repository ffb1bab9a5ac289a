"""Which latency figures an app's own status is about: those of its instances, as seldom changed as theirs.

A thousand instances publish new figures a thousand times a minute. The app's summary and messages, which name the worst
of them, follow once a minute, or when the verdict about the whole app changes.
"""

import dataclasses
from typing import NamedTuple

from robotapp_operator.plan.status.conditions import budget_met
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeView, Rest

Shown = dict[str, tuple[EdgeView, ...]]
"""Edges by instance."""


class Steady(NamedTuple):
    """The facts to render, and the second at which newer figures may be rendered (infinite: none are held back)."""

    facts: AppFacts
    again_s: float


def steady(facts: AppFacts, shown: Shown, rest: Rest, *, now_s: float) -> Steady:
    """The facts with the figures `shown` last, until newer ones may be published. Updates `shown` and `rest`."""
    before = dataclasses.replace(
        facts, instances=tuple(_with(instance, shown.get(instance.name)) for instance in facts.instances)
    )
    if before.instances == facts.instances:
        adopt(facts, shown)
        return Steady(facts, float("inf"))
    verdicts = {budget_met(facts).status, budget_met(before).status}
    flips, must = verdicts == {"True", "False"}, verdicts > {"Unknown"}
    due_s = now_s if must else rest.verdict_s if flips else rest.figures_s
    if now_s < due_s:
        return Steady(before, due_s)
    if must:
        rest.must_publish(now_s)
    else:
        rest.publish(now_s)
    adopt(facts, shown)
    return Steady(facts, float("inf"))


def adopt(facts: AppFacts, shown: Shown) -> None:
    """These are the figures that are shown now."""
    shown.clear()
    shown.update((instance.name, instance.edges) for instance in facts.instances)


def _with(instance: InstanceFacts, edges: tuple[EdgeView, ...] | None) -> InstanceFacts:
    """The instance with the edges shown before, if these are still about the same edges in the same places."""
    if edges is None or edges == instance.edges:
        return instance
    if {_place(edge) for edge in edges} != {_place(edge) for edge in instance.edges}:
        return instance
    return dataclasses.replace(instance, edges=edges)


def _place(edge: EdgeView) -> tuple[object, ...]:
    budget = edge.edge.latency
    return edge.key, edge.nodes, budget and (budget.budget, budget.percentile)
