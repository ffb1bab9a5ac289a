"""RegisteredPlugin: a plugin of a profile as the runner calls it, with its QueueingHint: when a pod is tried again that it rejected."""

import logging
from collections.abc import Callable, Hashable
from typing import Any, Final, NamedTuple

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import NODE, READS, Change, Event, interest_of
from robotapp_scheduler.core.framework.incremental import (
    BesideHook,
    Confined,
    FilterRow,
    GateGroup,
    HintOfEach,
    HintServes,
    Minds,
    Narrows,
    Plan,
    PlanClaims,
    Relevant,
    Room,
    ScoreAmong,
    ScoreRow,
    TouchedBy,
)
from robotapp_scheduler.core.framework.interface import FilterResult, PluginError, PreFilter, ScoreResult, Status
from robotapp_scheduler.core.framework.plugin_calls import CallJournal
from robotapp_scheduler.core.framework.plugin_results import NORMALIZERS
from robotapp_scheduler.core.framework.validation import problems_of
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.pods.pod_info import LIVE, PodInfo

log = logging.getLogger(__name__)

_SELF: Final = int(Change.SELF)


class QueueingHint(NamedTuple):
    """Which events may help a pod that one plugin rejected: first by kind of change, then by the plugin's `hint`."""

    plugin: str
    events: Change = Change.ALL
    hint: Callable[[PodInfo, Event], bool] | None = None
    reads: tuple[str, ...] = ()
    """Features of the pod that the result of `hint` depends on."""
    of_each: HintOfEach | None = None
    """True for events for which it depends on more than `reads`: then `hint` is called for every pod."""
    serves: HintServes | None = None
    """How many of the pods that are equal in `reads` the event can help; None: any number."""

    def key(self, pod: PodInfo) -> Hashable:
        """Key of a pod: `hint` returns the same for pods with equal keys."""
        if self.hint is None:
            return ()
        live = any(name.startswith(LIVE) for name in self.reads)
        return pod.live_features(self.reads) if live else pod.features(self.reads)

    def wants(self, pod: PodInfo, event: Event) -> bool:
        """Whether this event may help the pod. A hint that raises counts as yes: it must not hold a pod back for ever."""
        if not int(event.change) & (int(self.events) | _SELF):
            return False
        if self.hint is None or (event.old is None and event.new is None):
            return True
        try:
            return bool(self.hint(pod, event))
        except Exception:  # a plugin's mistake must not lose a pod; the log has the stack
            log.exception("queueing hint of %s failed for %s on %s", self.plugin, pod.key, event.label)
            return True

    def most(self, pod: PodInfo, event: Event) -> int | None:
        """How many of the pods with this pod's key the event can help; None: any number. Only after `wants` returned True."""
        if self.serves is None or (event.old is None and event.new is None):
            return None
        try:
            return self.serves(pod, event)
        except Exception:  # as in `wants`
            log.exception("%s cannot tell for %s how many %s serves", self.plugin, pod.key, event.label)
            return None


class RegisteredPlugin:
    """A plugin with its attributes checked once, hooks looked up and names of facts turned into flags.

    The hooks of both contracts are attributes here, None where the plugin has none. Raises PluginError for a class that cannot be used.
    """

    def __init__(self, plugin: Any, *, weight: int = 1, shadow: bool = False) -> None:
        problems = problems_of(plugin, NORMALIZERS)
        if problems:
            raise PluginError(str(getattr(plugin, "name", "") or type(plugin).__name__), "; ".join(problems))
        self.plugin = plugin
        self.name: str = plugin.name
        self.weight = weight
        self.shadow = shadow
        """Scored and recorded, but without effect on the choice."""
        self.journal: CallJournal | None = None
        """Entered around every call of a hook, where calls are recorded (shell.process.crash_journal)."""
        self.row_local: bool = getattr(plugin, "row_local", False)
        self.sound: bool = getattr(plugin, "sound", False)
        """See core.framework.incremental: results are not checked."""
        self.reason: str = getattr(plugin, "reason", f"node(s) were rejected by {self.name}")
        self.resolvable: bool = getattr(plugin, "resolvable", True)
        self.normalize: str = getattr(plugin, "normalize", "none")
        self.events: Change = getattr(plugin, "events", Change.ALL)
        self.reads: tuple[str, ...] = tuple(sorted(getattr(plugin, "reads", ("uid",))))
        node_reads: tuple[str | NodeFact, ...] = tuple(getattr(plugin, "node_reads", READS))
        self.reads_live = any(name.startswith(LIVE) for name in self.reads)
        """Whether it reads parts of "ros", or "volumes", whose values may differ from attempt to attempt of one pod."""
        # Without `row_local` a result may depend on which rows there are.
        self.interest = interest_of(node_reads) | (0 if self.row_local else int(NODE))
        """Kinds of change after which a changed row must be computed again, as a plain int."""
        self.watches = self.interest | int(NODE)
        """Kinds of change after which a column of results must be refreshed."""
        self.relevance = interest_of(getattr(plugin, "relevant_reads", node_reads)) | int(NODE)
        """Kinds of change after which `relevant` must be called again."""
        self.filter: Callable[[PodInfo, Snapshot], FilterResult] | None = getattr(plugin, "filter", None)
        self.score: Callable[[PodInfo, Snapshot], ScoreResult] | None = getattr(plugin, "score", None)
        self.score_among: ScoreAmong | None = getattr(plugin, "score_among", None)
        self.relevant: Relevant | None = getattr(plugin, "relevant", None)
        self.minds: Minds | None = getattr(plugin, "minds", None)
        self.confined: Confined | None = getattr(plugin, "confined", None)
        self.filter_row: FilterRow | None = getattr(plugin, "filter_row", None)
        self.score_row: ScoreRow | None = getattr(plugin, "score_row", None)
        self.pre_filter: Callable[[PodInfo, Snapshot], PreFilter | None] | None = getattr(plugin, "pre_filter", None)
        self.narrows: Narrows | None = getattr(plugin, "narrows", None)
        self.plan: Plan | None = getattr(plugin, "plan", None)
        self.plan_claims: PlanClaims | None = getattr(plugin, "plan_claims", None)
        self.post_filter: Callable[[PodInfo, Any], Any] | None = getattr(plugin, "post_filter", None)
        self.touched_by: TouchedBy | None = getattr(plugin, "touched_by", None)
        self.beside: BesideHook | None = getattr(plugin, "beside", None)
        self.room: Room | None = getattr(plugin, "room", None)
        self.queueing_hint = self._queueing_hint_of(plugin)
        self.pre_enqueue: Callable[[PodInfo], Status | None] | None = getattr(plugin, "pre_enqueue", None)
        self.gate_group: GateGroup | None = getattr(plugin, "gate_group", None)
        self.queue_key: Callable[[PodInfo, float], tuple[Any, ...]] | None = getattr(plugin, "queue_key", None)

    def _queueing_hint_of(self, plugin: Any) -> QueueingHint:
        return QueueingHint(
            self.name,
            self.events,
            getattr(plugin, "hint", None),
            tuple(sorted(getattr(plugin, "hint_reads", self.reads))),
            getattr(plugin, "hint_of_each", None),
            getattr(plugin, "hint_serves", None),
        )

    def interest_for(self, pod: PodInfo) -> int:
        """Kinds of change after which a changed row must be computed again for pods like this one."""
        return self.interest if self.minds is None else interest_of(self.minds(pod))

    def __repr__(self) -> str:
        return f"RegisteredPlugin({self.name}, weight={self.weight}{', shadow' if self.shadow else ''})"
