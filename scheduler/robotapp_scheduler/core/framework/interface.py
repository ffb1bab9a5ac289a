"""The plugin contract: how a rule is written, and what it may answer.

A plugin is a class with a `name` and any of the hooks below; nothing has to be inherited. The smallest useful one:

    class QuietNodes:
        name = "QuietNodes"
        reads = ()                      # pod features the result depends on (core.pods.pod_info.FEATURES)
        node_reads = ("requested",)     # node facts it depends on (core.events.cluster_event.READS)
        normalize = "minmax"

        def score(self, pod, nodes):
            return nodes.free("cpu")

Hooks, in the order of a cycle:

`pre_enqueue(pod) -> Status | None`          keep the pod out of the queue (gated)
`queue_key(pod, queued_s) -> tuple`          order of the active queue; exactly one plugin
`pre_filter(pod, nodes) -> PreFilter | None` narrow the nodes by name, or reject at once
`narrows(pod) -> bool`                       optional, beside it: False = no opinion about such pods; must follow from spec
                                             and labels, and from whether the pod has ROS fields (`pod.ros is None`)
`filter(pod, nodes) -> mask | Verdict | True | None`  bool per row, True = may run there; just True = everywhere,
                                             for now; None = no opinion about this pod (Skip; must follow from
                                             `reads` alone)
`post_filter(pod, failure) -> Outcome`        no node was left: what may be done about it (core.preemption.preemption)
`score(pod, nodes) -> array | PerDomain | int | None`
                                             number per row (or per value of a label), higher is better; one number =
                                             the same everywhere, for now; None = Skip (adds 0; must follow from `reads`
                                             alone)
`score_among(pod, nodes, feasible) -> array | int | None`
                                             instead of `score`, when it depends on which nodes are feasible: 0…100
                                             for each of these positions, already normalised. With `relevant`
`reserve(pod, node, ctx) -> Status | None`, `permit`, `pre_bind` (the same)
                                             asked in this order between choice and bind, plain or `async`; `node` is
                                             its name, `ctx` a core.framework.interface.BindContext. None = Success;
                                             Unschedulable waits for `events`, Pending without back-off, Error is
                                             retried after back-off
`unreserve(pod, node, ctx)`                  after `reserve`, when the pod is not bound there; may come twice
`post_bind(pod, node, ctx)`                  it is bound
`plan(pod, nodes) -> VolumePlan | None`      what must be written about volumes before the bind; `nodes` is the one chosen

`filter_row(pod, row) -> bool`, `score_row(pod, row) -> int`
                                             optional fast forms for one changed node, with plain integers:
                                             True = certainly passes (False: `filter` is asked); the same score
`ceiling(pod, nodes) -> array | int | None`  optional, beside `score_row` of a `row_local` plugin with scores of 0…100: a
                                             number per row (or one for all) that its score does not exceed when pods
                                             come to it, unless it did before: then its score does not rise. Must
                                             follow from what the nodes offer; None = unknown
`relevant(pod, nodes) -> bool`               optional, beside `score_among`: False = it would answer 0 everywhere now
`confined(pod, nodes, position) -> bool`     optional, when not `row_local`: did the pods placed and gone since this
                                             position of the change log alter the answers for their own rows only?
`minds(pod) -> names`                        optional: the facts that answers for such pods depend on, where they are
                                             fewer than `node_reads`; must follow from `reads` alone

`hint(pod, event) -> bool`                   may this event help a pod the plugin rejected? `event` (core.events.cluster_event.Event)
                                             has resource, action, change, old, new. Asked for kinds of change in
                                             `events`, and for every change of the pod itself (Change.SELF in
                                             event.change); without a hint each of these counts. Decide from the pod and
                                             the event alone: never from the cluster, never from `pod.ros`. True when
                                             unsure; raising counts as True

`touched_by(pod, other) -> bool`             optional, for filters: may the coming or going of a placed pod, on any node,
                                             change this filter's verdict about `pod`? Asked whatever `node_reads` says;
                                             without it: True when `node_reads` names facts of pods. False lets
                                             preemption decide by amounts alone
`beside(pod, nodes) -> Beside | None`        optional, beside `touched_by`: a test whether a node's row takes the pod
                                             when of its pods just these stay there; None = the rule must be tried out
`room(pod) -> mapping`                       for one filter of a profile: it passes exactly where one more pod and these
                                             amounts are free

Class attributes and their defaults:

`reads`       features of the pod; default: everything (the result is never shared between pods)
`node_reads`  facts of the nodes; default: everything
`relevant_reads`  facts that `relevant` depends on; default: `node_reads`
`row_local`   True: a row's result depends on that row alone, so only changed rows are computed again; default False
`events`      changes that may help a pod this plugin rejected; default: every change
`hint_reads`  features of the pod that `hint` depends on; default: `reads`. Waiting pods that are equal in them are
              asked about once, so name as few as you can; `hint_of_each(event) -> bool` says for which events it
              depends on more features, so that every pod is asked about; `hint_serves(pod, event) -> int | None`
              how many of those equal pods it can help: so many are tried, the others second by second (None: all at once)
`reason`      text for rows a bare mask rejects
`resolvable`  False: taking other pods away cannot help (UnschedulableAndUnresolvable)
`normalize`   "none" (raw is 0…100), "max", "inverse" or "minmax"; see `normalized`
`Args`        msgspec.Struct of the arguments; the class is then called with an instance of it

Arrays have one element per row of `nodes` (holes included: rows without a node never win), masks are bool, scores are
integers or floats without NaN. Anything else is an Error: the pod is not placed and the text names the plugin.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from functools import wraps
from typing import Any, Final, Literal, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.snapshot import LabelColumn, Snapshot
from robotapp_scheduler.core.events.cluster_event import NODE, READS, Change, interest_of
from robotapp_scheduler.core.framework.plugin_calls import Asking
from robotapp_scheduler.core.framework.queueing_hint import QueueingHint
from robotapp_scheduler.core.framework.validation import problems_of
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.core.pods.pod_info import LIVE, PlacedPod, PodInfo
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan

MAX_SCORE: Final = 100


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
    """What a hook says about the whole pod."""

    code: Code
    reason: str = ""
    plugin: str = ""


class PreFilter(NamedTuple):
    """Answer of `pre_filter`: only these nodes (None = no limit), or a rejection of the pod."""

    names: frozenset[str] | None = None
    status: Status | None = None


class Verdict(NamedTuple):
    """Answer of `filter` with more to say than a mask.

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
    """Answer of `score` where all nodes with the same value of a label get the same.

    `values` has one number per code of the label.
    """

    values: npt.NDArray[Any]
    label: LabelColumn


class Scores(NamedTuple):
    """Answer of `score` that is normalised in another way than the plugin's `normalize` says."""

    raw: npt.NDArray[Any]
    normalize: str


FilterResult = BoolArray | Verdict | Literal[True] | None
ScoreResult = npt.NDArray[Any] | PerDomain | Scores | int | None
AmongResult = npt.NDArray[Any] | int | None
Positions = npt.NDArray[np.intp]
AmongHook = Callable[[PodInfo, Snapshot, Positions], AmongResult]


class Beside(NamedTuple):
    """Answer of `beside`. `confined`: nothing that happens on other nodes changes what `takes` says about a node."""

    takes: Callable[[int, Sequence[PlacedPod]], bool]
    confined: bool = True


class PluginError(Exception):
    """A plugin answered something that cannot be used; the pod gets SchedulerError with this text."""

    def __init__(self, plugin: str, text: str) -> None:
        super().__init__(f"plugin {plugin}: {text}")
        self.plugin = plugin


class NoArgs(msgspec.Struct, forbid_unknown_fields=True):
    """Arguments of plugins that have none."""


class RegisteredPlugin:
    """A plugin with its attributes checked once: hooks looked up, names of features turned into flags."""

    def __init__(self, plugin: Any, *, weight: int = 1, shadow: bool = False) -> None:
        problems = problems_of(plugin, NORMALIZERS)
        if problems:
            raise PluginError(str(getattr(plugin, "name", "") or type(plugin).__name__), "; ".join(problems))
        self.plugin = plugin
        self.name: str = plugin.name
        self.weight = weight
        self.shadow = shadow
        """Scored and recorded, but the choice does not look at it."""
        self.vigil: Asking | None = None
        """Is told of every question, if somebody wants to know."""
        self.row_local: bool = getattr(plugin, "row_local", False)
        self.sound: bool = getattr(plugin, "sound", False)
        """One of ours that never divides by 0 and whose scores are int64 in 0…100: what it answers is not looked at."""
        self.reason: str = getattr(plugin, "reason", f"node(s) were rejected by {self.name}")
        self.resolvable: bool = getattr(plugin, "resolvable", True)
        self.normalize: str = getattr(plugin, "normalize", "none")
        self.events: Change = getattr(plugin, "events", Change.ALL)
        self.reads: tuple[str, ...] = tuple(sorted(getattr(plugin, "reads", ("uid",))))
        node_reads: tuple[str, ...] = tuple(getattr(plugin, "node_reads", READS))
        self.reads_live = any(name.startswith(LIVE) for name in self.reads)
        """Reads parts of "ros", or "volumes": its columns are found by what these are at this attempt."""
        self.interest = interest_of(node_reads) | (0 if self.row_local else int(NODE))  # which rows there are
        """Changes after which a row must be looked at again, as a plain int."""
        self.watches = self.interest | int(NODE)
        """Changes after which a column of results must be looked at."""
        self.relevance = interest_of(getattr(plugin, "relevant_reads", node_reads)) | int(NODE)
        """Changes after which `relevant` must be asked again."""
        self.filter: Callable[[PodInfo, Snapshot], FilterResult] | None = getattr(plugin, "filter", None)
        self.score: Callable[[PodInfo, Snapshot], ScoreResult] | None = getattr(plugin, "score", None)
        self.score_among: AmongHook | None = getattr(plugin, "score_among", None)
        self.relevant: Callable[[PodInfo, Snapshot], bool] | None = getattr(plugin, "relevant", None)
        self.minds: Callable[[PodInfo], Iterable[str]] | None = getattr(plugin, "minds", None)
        self.confined: Callable[[PodInfo, Snapshot, int], bool] | None = getattr(plugin, "confined", None)
        self.filter_row: Callable[[PodInfo, Row], bool] | None = getattr(plugin, "filter_row", None)
        self.score_row: Callable[[PodInfo, Row], int] | None = getattr(plugin, "score_row", None)
        self.ceiling: Callable[[PodInfo, Snapshot], IntArray | int | None] | None = getattr(plugin, "ceiling", None)
        self.pre_filter: Callable[[PodInfo, Snapshot], PreFilter | None] | None = getattr(plugin, "pre_filter", None)
        self.narrows: Callable[[PodInfo], bool] | None = getattr(plugin, "narrows", None)
        self.plan: Callable[[PodInfo, Snapshot], VolumePlan | None] | None = getattr(plugin, "plan", None)
        self.post_filter: Callable[[PodInfo, Any], Any] | None = getattr(plugin, "post_filter", None)
        self.touched_by: Callable[[PodInfo, PlacedPod], bool] | None = getattr(plugin, "touched_by", None)
        self.beside: Callable[[PodInfo, Snapshot], Beside | None] | None = getattr(plugin, "beside", None)
        self.room: Callable[[PodInfo], Mapping[str, int]] | None = getattr(plugin, "room", None)
        self.waker = self._waker_of(plugin)
        self.pre_enqueue: Callable[[PodInfo], Status | None] | None = getattr(plugin, "pre_enqueue", None)
        self.queue_key: Callable[[PodInfo, float], tuple[Any, ...]] | None = getattr(plugin, "queue_key", None)

    def _waker_of(self, plugin: Any) -> QueueingHint:
        return QueueingHint(
            self.name,
            self.events,
            getattr(plugin, "hint", None),
            tuple(sorted(getattr(plugin, "hint_reads", self.reads))),
            getattr(plugin, "hint_of_each", None),
            getattr(plugin, "hint_serves", None),
        )

    def interest_for(self, pod: PodInfo) -> int:
        """Changes after which a row of what it says about such pods must be looked at again."""
        return self.interest if self.minds is None else interest_of(self.minds(pod))

    def __repr__(self) -> str:
        return f"RegisteredPlugin({self.name}, weight={self.weight}{', shadow' if self.shadow else ''})"


# --- Checks and arithmetic the framework does for every plugin --------------------------------------------------------


def checked_mask(plugin: str, mask: object, rows: int) -> BoolArray:
    """The mask of a filter, or PluginError."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (rows,):
        found = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
        raise PluginError(plugin, f"filter must answer a bool array of shape ({rows},), got {found}")
    return mask


def checked_scores(plugin: str, scores: object, rows: int, *, hook: str = "score") -> npt.NDArray[Any]:
    """The raw scores of a plugin, or PluginError: numbers, one per row. NaN only counts where a node is feasible."""
    if not isinstance(scores, np.ndarray) or scores.dtype.kind not in "iuf" or scores.shape != (rows,):
        found = f"{scores.dtype} {scores.shape}" if isinstance(scores, np.ndarray) else type(scores).__name__
        raise PluginError(plugin, f"{hook} must answer a number array of shape ({rows},), got {found}")
    return scores


def _integers(raw: npt.NDArray[Any]) -> IntArray:
    return raw.astype(np.int64)  # truncates floats toward zero, as Go's int64() does


def _by_max(raw: npt.NDArray[Any]) -> IntArray:
    top = raw.max()
    return _integers(MAX_SCORE * raw // top) if top > 0 else np.zeros(len(raw), dtype=np.int64)


def _inverse(raw: npt.NDArray[Any]) -> IntArray:
    top = raw.max()
    if top <= 0:
        return np.full(len(raw), MAX_SCORE, dtype=np.int64)
    return MAX_SCORE - _integers(MAX_SCORE * raw // top)


def _minmax(raw: npt.NDArray[Any]) -> IntArray:
    low, high = raw.min(), raw.max()
    if high == low:
        return np.zeros(len(raw), dtype=np.int64)
    # Dividing first is upstream's order of operations: 29 of 100 gives 28.
    return _integers(float(MAX_SCORE) * ((raw - low) / (high - low)))


NORMALIZERS: Final[dict[str, Callable[[npt.NDArray[Any]], IntArray]]] = {
    "none": _integers,
    "max": _by_max,
    "inverse": _inverse,
    "minmax": _minmax,
}


def normalized(plugin: str, how: str, raw: npt.NDArray[Any]) -> IntArray:
    """Scores 0…100 of the feasible rows from their raw values (the array holds only those rows).

    "max": 100·s // max, 0 when max is 0. "inverse": 100 - 100·s // max, 100 when max is 0.
    "minmax": int(100·((s-min)/(max-min))), 0 when all are equal. "none": the integer part.
    Raises PluginError when the result leaves 0…100.
    """
    scores = NORMALIZERS[how](raw)
    if len(scores) and (scores.min() < 0 or scores.max() > MAX_SCORE):
        bad = int(scores.min()) if scores.min() < 0 else int(scores.max())
        raise PluginError(plugin, f"returns an invalid score {bad}, it should in the range of [0, {MAX_SCORE}]")
    return scores


# --- Messages --------------------------------------------------------------------------------------------------------


def histogram(total: int, counts: dict[str, int]) -> str:
    """kube-scheduler's text for a pod no node accepts; entries are sorted as strings ("10 x" before "2 y")."""
    if total == 0:
        return "no nodes available to schedule pods"
    entries = sorted(f"{count} {reason}" for reason, count in counts.items() if count)
    return f"0/{total} nodes are available" + (f": {', '.join(entries)}." if entries else ".")


def pre_filter_message(total: int, text: str) -> str:
    """The text when a pre_filter rejected the pod."""
    return f"0/{total} nodes are available: {text}."


# --- Scalar plugins ----------------------------------------------------------------------------------------------------


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
        """What the node offers."""
        return int(self._nodes.allocatable(resource)[self._i])

    def requested(self, resource: str) -> int:
        """What its pods ask for."""
        return int(self._nodes.requested(resource)[self._i])


class BindContext:
    """One attempt to bind a pod. `annotations` go into the Binding, so the pod has them the moment it is bound.

    `kept` is for the plugin's own use, from `reserve` to `post_bind`.
    """

    __slots__ = ("annotations", "kept")

    def __init__(self) -> None:
        self.annotations: dict[str, str] = {}
        self.kept: dict[str, object] = {}

    def __repr__(self) -> str:
        return f"BindContext({self.annotations})"
