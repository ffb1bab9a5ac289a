"""RegisteredPlugin: a plugin of a profile as the runner calls it."""

from collections.abc import Callable
from typing import Any

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import NODE, READS, Change, interest_of
from robotapp_scheduler.core.framework.incremental import (
    BesideHook,
    Confined,
    FilterRow,
    Minds,
    Narrows,
    Plan,
    Relevant,
    Room,
    ScoreAmong,
    ScoreRow,
    TouchedBy,
)
from robotapp_scheduler.core.framework.interface import FilterResult, PluginError, PreFilter, ScoreResult, Status
from robotapp_scheduler.core.framework.plugin_calls import CallJournal
from robotapp_scheduler.core.framework.plugin_results import NORMALIZERS
from robotapp_scheduler.core.framework.queueing_hint import QueueingHint
from robotapp_scheduler.core.framework.validation import problems_of
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.pods.pod_info import LIVE, PodInfo


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
        self.post_filter: Callable[[PodInfo, Any], Any] | None = getattr(plugin, "post_filter", None)
        self.touched_by: TouchedBy | None = getattr(plugin, "touched_by", None)
        self.beside: BesideHook | None = getattr(plugin, "beside", None)
        self.room: Room | None = getattr(plugin, "room", None)
        self.queueing_hint = self._queueing_hint_of(plugin)
        self.pre_enqueue: Callable[[PodInfo], Status | None] | None = getattr(plugin, "pre_enqueue", None)
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
