"""The plugin interface: what the author of a scheduler plugin needs. The manual is docs/how-to/write-a-plugin.md.

A plugin is a class with a `name` and any of the hooks below; nothing has to be inherited. A small useful one:

    import numpy as np

    class QuietNodes:
        name = "QuietNodes"
        reads = ()  # of the pod: nothing
        node_reads = ("requested", "allocatable")
        row_local = True  # a node's result depends on that node alone
        reason = "node(s) were too busy"
        normalize = "max"

        def filter(self, pod, nodes):
            return nodes.free("cpu") >= 2000

        def score(self, pod, nodes):
            return np.maximum(nodes.free("cpu"), 0)

Hooks, in the order of a cycle:

`pre_enqueue(pod) -> Status | None`          keep the pod out of the queue (gated)
`queue_key(pod, queued_s) -> tuple`          order of the active queue; exactly one plugin
`pre_filter(pod, nodes) -> PreFilter | None` narrow the nodes by name, or reject the pod at once
`filter(pod, nodes) -> FilterResult`         bool per node, True = may run there; just True = everywhere, for now; a Verdict
                                             has reasons per node; None = Skip (the filter does not apply to this pod; must follow
                                             from `reads` alone)
`post_filter(pod, failure) -> Outcome`       no node was left: what may be done about it (core.preemption.preemption)
`score(pod, nodes) -> ScoreResult`           number per node (PerDomain: per value of a label), higher is better; one number =
                                             the same everywhere, for now; None = Skip (adds 0; must follow from `reads` alone)
`reserve(pod, node, ctx) -> Status | None`, `permit`, `pre_bind` (the same)
                                             called in this order between choice and bind, plain or `async`; `node` is its
                                             name, `ctx` a BindContext. None = Success; Unschedulable waits for `events`,
                                             Pending without back-off, Error is retried after back-off
`bind(pod, node, ctx) -> Status | BindOutcome | None`
                                             sends the Binding, through `ctx.handle.pods` or its own way, plain or
                                             `async`. None = bound; Skip = the next bind plugin of the profile is called
`unreserve(pod, node, ctx)`                  after `reserve`, when the pod is not bound there; may come twice
`post_bind(pod, node, ctx)`                  after the bind
`hint(pod, event) -> bool`                   may this event help a pod the plugin rejected? `event` (core.events.cluster_event.Event)
                                             has resource, action, change, old, new. Called for kinds of change in `events`,
                                             and for every change of the pod itself (Change.SELF in event.change); without
                                             a hint each of these counts. Decide from the pod and the event alone: never
                                             from the cluster, never from `pod.ros`. True when unsure; raising counts as True

Class attributes and their defaults:

`reads`       features of the pod that results depend on (core.pods.pod_info.FEATURES); default: everything (a result is never
              shared between pods)
`node_reads`  facts of nodes that results depend on (core.events.cluster_event.READS, and NodeFacts of core.nodes.node_facts);
              default: everything
`row_local`   True: a node's result depends on that node alone, so only changed rows are computed again; default False
`events`      changes that may help a pod this plugin rejected; default: every change
`reason`      text for nodes that a bare mask rejects
`resolvable`  False: taking other pods away cannot help (UnschedulableAndUnresolvable)
`normalize`   "none" (raw is 0…100), "max", "inverse" or "minmax"; see core.framework.plugin_results.normalized
`Args`        msgspec.Struct of the arguments; the class is then called with an instance of it

Arrays have one element per row of `nodes` (holes included: rows without a node never win), masks are bool, scores are
integers or floats without NaN. Anything else is an Error: the pod is not placed and the text names the plugin.

Optional hooks that only make results cheaper to repair are the second contract, core.framework.incremental.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import wraps
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.snapshot import LabelColumn, Snapshot
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan
from robotapp_scheduler.core.framework.handle import READY, Handle
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan

MAX_SCORE: Final = 100
ABORTS: Final = ("the attempt ends with an error",)
"""The reason of rows on which `filter` found that the pod cannot be scheduled at all; `plan_claims` raises the error for them."""


class Code(StrEnum):
    """Outcome of a hook, in kube-scheduler's words."""

    SUCCESS = "Success"
    ERROR = "Error"
    UNSCHEDULABLE = "Unschedulable"
    UNRESOLVABLE = "UnschedulableAndUnresolvable"
    WAIT = "Wait"
    SKIP = "Skip"
    PENDING = "Pending"


class Status(NamedTuple):
    """Result of a hook that concerns the whole pod."""

    code: Code
    reason: str = ""
    plugin: str = ""


class PreFilter(NamedTuple):
    """Result of `pre_filter`: only these nodes (None = no limit), or a rejection of the pod."""

    names: frozenset[str] | None = None
    status: Status | None = None


class Verdict(NamedTuple):
    """Result of `filter` with reasons and numbers beside the mask.

    `codes` index `reasons` per row (only rows with mask False are read); one entry of `reasons` may hold several texts,
    all of which are reported. `detail` is a number per row for explain (milliseconds, free devices …), named by
    `detail_unit`. `resolvable` is one value, one per row, or (a tuple) one per entry of `reasons`.
    With `label`, `mask` and `codes` have one element per code of this label instead, and there is no `detail`.
    """

    mask: BoolArray
    codes: npt.NDArray[np.integer[Any]] | None = None
    reasons: Sequence[tuple[str, ...]] = ()
    detail: FloatArray | None = None
    detail_unit: str = ""
    resolvable: BoolArray | bool | tuple[bool, ...] | None = None
    label: LabelColumn | None = None


class PerDomain(NamedTuple):
    """Result of `score` where all nodes with the same value of a label get the same score.

    `values` has one number per code of the label.
    """

    values: npt.NDArray[Any]
    label: LabelColumn


class Scores(NamedTuple):
    """Result of `score` that is normalised in another way than the plugin's attribute `normalize`."""

    raw: npt.NDArray[Any]
    normalize: str


FilterResult = BoolArray | Verdict | Literal[True] | None
ScoreResult = npt.NDArray[Any] | PerDomain | Scores | int | None


class PluginError(Exception):
    """A plugin returned a value that cannot be used; the pod gets SchedulerError with this text."""

    def __init__(self, plugin: str, text: str) -> None:
        super().__init__(f"plugin {plugin}: {text}")
        self.plugin = plugin


def per_node(
    function: Callable[[Any, PodInfo, "NodeRow"], Any],
) -> Callable[[Any, PodInfo, Snapshot], npt.NDArray[Any]]:
    """Turn `(self, pod, node) -> bool | number` into a hook over all nodes: slow, fine for a first try.

    `node` has name, labels, free(resource), allocatable(resource) and requested(resource).
    """

    @wraps(function)
    def hook(self: Any, pod: PodInfo, nodes: Snapshot) -> npt.NDArray[Any]:
        values = [function(self, pod, NodeRow(nodes, i)) if name else None for i, name in enumerate(nodes.names)]
        example = next((value for value in values if value is not None), False)
        blank: Any = False if isinstance(example, bool) else 0
        return np.array(
            [blank if value is None else value for value in values], dtype=np.bool_ if blank is False else None
        )

    return hook


class NodeRow:
    """One node as a `per_node` function sees it."""

    __slots__ = ("_i", "_nodes")

    def __init__(self, nodes: Snapshot, i: int) -> None:
        self._nodes = nodes
        self._i = i

    @property
    def name(self) -> str:
        """The node's name."""
        return self._nodes.names[self._i]

    @property
    def labels(self) -> dict[str, str]:
        """The node's labels."""
        return self._nodes.labels_of(self._i)

    def free(self, resource: str) -> int:
        """Allocatable minus requested: cpu in milli, others in whole units."""
        return int(self._nodes.free(resource)[self._i])

    def allocatable(self, resource: str) -> int:
        """Allocatable of the node: cpu in milli, others in whole units."""
        return int(self._nodes.allocatable(resource)[self._i])

    def requested(self, resource: str) -> int:
        """Sum of the requests of its pods."""
        return int(self._nodes.requested(resource)[self._i])


class BindContext:
    """One attempt to bind a pod. `annotations` go into the Binding, so the pod has them the moment it is bound.

    `kept` is for the plugin's own use, from `reserve` to `post_bind`; `handle` writes to the API server.
    `grants` are the devices, `volumes` and `claims` the plans that were chosen with the node.
    """

    __slots__ = (
        "annotations",
        "annotations_read",
        "claims",
        "grants",
        "handle",
        "kept",
        "refused",
        "reserved",
        "sent",
        "volumes",
    )

    def __init__(
        self,
        handle: Handle,
        *,
        grants: Sequence[DeviceGrant] = (),
        volumes: VolumePlan | None = None,
        claims: ClaimPlan | None = None,
    ) -> None:
        self.handle = handle
        self.grants = grants
        self.volumes = volumes
        self.claims = claims
        self.annotations: dict[str, str] = {}
        self.annotations_read = False
        """Whether a bind hook has read `binding_annotations`, without which it cannot hand the grants over."""
        self.kept: dict[str, object] = {}
        self.reserved = READY
        """The result of ROSReserve: grants for the Binding, and the version of the pod that is its precondition."""
        self.sent = False
        """Whether a Binding may have been sent. The pod's claims must stay then: after a lost reply it may be bound."""
        self.refused: Exception | None = None
        """The error of the first try of the bind where that was made without waiting (`Pods.send`)."""

    def __repr__(self) -> str:
        return f"BindContext({self.annotations})"

    @property
    def binding_annotations(self) -> dict[str, str]:
        """All annotations of the Binding: those of the plugins and the grants."""
        self.annotations_read = True
        return {**self.annotations, **self.reserved.annotations}
