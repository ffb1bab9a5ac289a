"""The incremental contract: optional hooks that make results cheaper to repair, and what happens without each.

No result depends on them: a plugin that has only the hooks of core.framework.interface decides the same. Built-in plugins have
those that a measurement justified; plugins of other authors need none. Each type below is one hook.

Three attributes belong to them:

`relevant_reads`  facts of nodes that `relevant` depends on. Without it: `node_reads`.
`hint_reads`      features of the pod that `hint` depends on. Waiting pods that are equal in them get one call of `hint`, so
                  name as few as possible. Without it: `reads`.
`sound`           True: the plugin never divides by 0 and its scores are int64 in 0…100. Without it: every result is checked.
                  Ignored in plugins of other authors.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.framework.interface import BindContext, Code
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan

# --- Row forms: one changed node with plain integers ------------------------------------------------------------------

FilterRow = Callable[[PodInfo, Row], bool]
"""`filter_row(pod, row)`: True = the node certainly passes; False = `filter` decides. Without it: `filter` for every changed row."""
ScoreRow = Callable[[PodInfo, Row], int]
"""`score_row(pod, row)`: the same score as `score`. It must follow from pod and amounts alone: nodes with equal amounts may share the
result. Without it: `score` for every changed row.
"""

# --- Scores that depend on which nodes are feasible -------------------------------------------------------------------

Positions = npt.NDArray[np.intp]
AmongResult = npt.NDArray[Any] | int | None
ScoreAmong = Callable[[PodInfo, Snapshot, Positions], AmongResult]
"""`score_among(pod, nodes, feasible)`, instead of `score`: 0…100 for each of these positions, already normalised.

It is called for every decision. Without it: `score`, whose results are kept.
"""
Relevant = Callable[[PodInfo, Snapshot], bool]
"""`relevant(pod, nodes)`, with `score_among`: False = it would return 0 everywhere now. Without it: `score_among` for every pod."""

# --- Dependency hints: which pods and which changes matter ------------------------------------------------------------

Narrows = Callable[[PodInfo], bool]
"""`narrows(pod)`, with `pre_filter`: False = it neither narrows nor rejects such pods. Without it: `pre_filter` for every pod.

It must follow from spec and labels, and from whether the pod has ROS fields (`pod.ros is None`).
"""
Minds = Callable[[PodInfo], Iterable[str | NodeFact]]
"""`minds(pod)`: the facts that results for such pods depend on, where they are fewer than `node_reads`.

It must follow from `reads` alone. Without it: all of `node_reads`.
"""
Confined = Callable[[PodInfo, Snapshot, int], bool]
"""`confined(pod, nodes, position)`, when not `row_local`: did the pods that came and went since this position of the change log alter
the results of their own rows only? Without it: all rows are computed again.
"""
HintOfEach = Callable[[Event], bool]
"""`hint_of_each(event)`: does `hint` depend on more than `hint_reads` for this event? Without it: never."""
HintServes = Callable[[PodInfo, Event], int | None]
"""`hint_serves(pod, event)`: how many of the pods that are equal in `hint_reads` the event can help; None = any number.

So many are tried at once, the others second by second. Without it: all are tried at once.
"""
GateGroup = Callable[[PodInfo], str]
"""`gate_group(pod)`, with `pre_enqueue`: the group whose events alone may open the gate that was just closed (`groups_of` of
core.cycle.group_gates), "" for any event. Without it: any of `events`.
"""

# --- Preemption: what a filter decides once pods are gone -------------------------------------------------------------

TouchedBy = Callable[[PodInfo, PlacedPod], bool]
"""`touched_by(pod, other)`: may the coming or going of a placed pod, on any node, change this filter's result for `pod`?

It is called whatever `node_reads` names; False lets preemption decide by amounts alone. Without it: True when `node_reads` names facts
of pods.
"""


class Beside(NamedTuple):
    """Result of `beside`. `confined`: nothing that happens on other nodes changes what `takes` returns for a node."""

    takes: Callable[[int, Sequence[PlacedPod]], bool]
    confined: bool = True


BesideHook = Callable[[PodInfo, Snapshot], Beside | None]
"""`beside(pod, nodes)`, with `touched_by`: a test whether a node's row takes the pod when just these of its pods stay there.

None = no such test for this pod. Without it: the filter runs in a dry run for every candidate.
"""
Room = Callable[[PodInfo], Mapping[str, int]]
"""`room(pod)`, of one filter of a profile: it passes exactly where one more pod and these amounts are free.

Without it in any filter: preemption runs every filter for every candidate.
"""

# --- Volumes and resource claims ----------------------------------------------------------------------------------------

Plan = Callable[[PodInfo, Snapshot], VolumePlan | None]
"""`plan(pod, nodes)`: what must be written about volumes before the bind; `nodes` is the one chosen. Without it: nothing is written."""

PlanClaims = Callable[[PodInfo, Snapshot], ClaimPlan | None]
"""`plan_claims(pod, nodes)`: the same about resource claims. Raises ValueError when the claims cannot be allocated anywhere."""

# --- Around the bind, of built-in plugins only ------------------------------------------------------------------------

PreFlight = Callable[[PodInfo, BindContext], Code]
"""`pre_flight(pod, ctx)`: Skip = `reserve`, `permit` and `pre_bind` have nothing to do for this pod and are not called; Wait = `pre_bind`
may take minutes; else Success. Without it: each of these hooks is called for every pod.
"""
Send = Callable[[PodInfo, str, BindContext, Callable[[Exception | None], None]], None]
"""`send(pod, node, ctx, done)`, with `bind`: the Binding of a pod for which no plugin has work; nothing is awaited, `done` gets the
result. Without it: `bind` for every pod.
"""
