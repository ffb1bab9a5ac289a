"""Runs the filters and scores of one profile: finds or makes the evaluation of a pod's class and brings it up to date."""

import logging
from collections.abc import Callable, Hashable
from functools import cache
from hashlib import blake2b
from typing import Any, Final, NamedTuple, Protocol, TypeVar

import numpy as np

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan
from robotapp_scheduler.core.framework.interface import ABORTS, Code, Status
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import FilterColumn
from robotapp_scheduler.core.runtime.incremental import bring_up
from robotapp_scheduler.core.runtime.result_cache import ResultCache
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan

log = logging.getLogger(__name__)
_T = TypeVar("_T")

MOST_OUTCOMES: Final = 16
"""Combinations of reasons that a `Tally` holds before its counts are added to the metrics."""
POINTS: Final = ("PreFilter", "Filter", "Score")
"""Extension points that a stopwatch measures."""


class PreFilterResult(NamedTuple):
    """What the pre_filter hooks left: names (None = all nodes) and the plugins that narrowed, or a rejection."""

    names: frozenset[str] | None
    plugins: tuple[str, ...]
    status: Status | None


UNLIMITED: Final = PreFilterResult(None, (), None)


class Stopwatch(Protocol):
    """Runs a part of a decision and measures how long it takes."""

    def due(self) -> Callable[[], bool]:
        """A function that returns, for each call to come, whether it is to be measured."""

    def __call__(self, point: str, profile: str, work: Callable[[], _T]) -> _T: ...


class ProfileRunner:
    """Evaluates pods for one profile. Keeps results per class; `caching=False` computes everything each time."""

    def __init__(
        self, profile: Profile, cluster: Cache, *, caching: bool = True, stopwatch: Stopwatch | None = None
    ) -> None:
        self.profile = profile
        self._cluster = cluster
        self._caching = caching
        self._stopwatch = stopwatch
        self._due = {point: stopwatch.due() for point in POINTS} if stopwatch is not None else {}
        self._plain, self._with_ros = object(), object()
        """Keys of this runner in `PodSignature.notes`, for pods without and with ROS fields."""
        self._results = ResultCache(profile, cluster, self._flush)
        self._full: tuple[int, Snapshot] | None = None
        """A view of all nodes, and the position of the change log when it was made."""
        self._counts: dict[tuple[str, str, str], int] = {}

    def __repr__(self) -> str:
        return f"ProfileRunner({self.profile.scheduler_name}, {len(self._results)} classes)"

    def decisions(self) -> dict[tuple[str, str, str], int]:
        """(plugin, point, result) → pods, for scheduler_plugin_decisions_total."""
        for evaluation in self._results:
            self._flush(evaluation)
        return dict(self._counts)

    # --- PreFilter -----------------------------------------------------------------------------------------------

    def pre_filter(self, pod: PodInfo) -> PreFilterResult:
        """Run all pre_filter hooks: intersect the node names they allow; an unresolvable rejection ends it at once."""
        if self._stopwatch is None or not self._due["PreFilter"]():
            return self._pre_filter(pod)
        return self._stopwatch("PreFilter", self.profile.scheduler_name, lambda: self._pre_filter(pod))

    def _pre_filter(self, pod: PodInfo) -> PreFilterResult:
        narrowing = self._narrowing(pod)
        if not narrowing:
            return UNLIMITED
        names: frozenset[str] | None = None
        plugins: list[str] = []
        rejection: Status | None = None
        nodes = Snapshot(self._cluster)
        for loaded in narrowing:
            answer = loaded.pre_filter(pod, nodes) if loaded.pre_filter is not None else None
            if answer is None:
                continue
            if answer.status is not None and answer.status.code is not Code.SUCCESS:
                self._count(loaded.name, "pre_filter", "reject")
                status = answer.status._replace(plugin=loaded.name)
                if status.code is not Code.UNSCHEDULABLE:
                    return PreFilterResult(None, (loaded.name,), status)
                rejection = rejection or status
            if answer.names is not None:
                plugins.append(loaded.name)
                names = answer.names if names is None else names & answer.names
                if not names:
                    return PreFilterResult(frozenset(), tuple(plugins), _nothing_left(plugins))
        return PreFilterResult(names, tuple(plugins), rejection)

    def _narrowing(self, pod: PodInfo) -> list[RegisteredPlugin]:
        """The plugins whose pre_filter may narrow or reject such pods."""
        notes, key = pod.signature.notes, self._plain if pod.ros is None else self._with_ros
        found: list[RegisteredPlugin] | None = notes.get(key)
        if found is None:
            found = notes[key] = [
                each for each in self.profile.pre_filters if each.narrows is None or each.narrows(pod)
            ]
        return found

    # --- Evaluation ----------------------------------------------------------------------------------------------

    def evaluate(self, pod: PodInfo, names: frozenset[str] | None) -> Evaluation:
        """First reason per row for this pod. `names` limits the rows; then nothing is cached."""
        if self._stopwatch is None or not self._due["Filter"]():
            return self._evaluate(pod, names)
        return self._stopwatch("Filter", self.profile.scheduler_name, lambda: self._evaluate(pod, names))

    def _evaluate(self, pod: PodInfo, names: frozenset[str] | None) -> Evaluation:
        if names is not None:
            rows = sorted(row for name in names if (row := self._cluster.nodes.row_of.get(name)) is not None)
            nodes = Snapshot(self._cluster, rows)
            evaluation = self._results.uncached()
            evaluation.compute_filters(pod, nodes)
        else:
            evaluation = self._results.evaluation(pod) if self._caching else self._results.uncached()
            evaluation.refresh_filters(pod, self._all_nodes())
        self._count_filters(evaluation)
        if evaluation.rows is not None or not self._caching:
            self._flush(evaluation)
        return evaluation

    def score(self, pod: PodInfo, evaluation: Evaluation) -> None:
        """Totals for the feasible rows. Raises PluginError."""
        if self._stopwatch is None or not self._due["Score"]():
            self._score(pod, evaluation)
        else:
            self._stopwatch("Score", self.profile.scheduler_name, lambda: self._score(pod, evaluation))

    def _all_nodes(self) -> Snapshot:
        """The view of all nodes: filters and scores of one attempt share the columns it has made."""
        position = self._cluster.log.position
        if self._full is None or self._full[0] != position:
            self._full = (position, Snapshot(self._cluster))
        return self._full[1]

    def _score(self, pod: PodInfo, evaluation: Evaluation) -> None:
        if evaluation.rows is not None:
            evaluation.compute_scores(pod, Snapshot(self._cluster, [int(row) for row in evaluation.rows]))
        else:
            evaluation.refresh_scores(pod, self._all_nodes())
        evaluation.tally.scored += 1
        if evaluation.rows is not None or not self._caching:
            self._flush(evaluation)

    def watch_shadows(self, pod: PodInfo, evaluation: Evaluation, chosen: int) -> tuple[str, ...]:
        """The shadow plugins that would have changed this choice; counts both outcomes per plugin for the metrics.

        A filter would have changed it when it rejects the chosen node, a score when another node would have won.
        """
        if not self.profile.has_shadows:
            return ()
        row = chosen if evaluation.rows is None else int(evaluation.rows[chosen])
        verdicts: dict[str, bool] = {}
        for column in self._results.shadow_filters(pod):
            refuses = self._shadow_refuses(column, pod, row)
            if refuses is not None:
                verdicts[column.plugin.name] = refuses
        if evaluation.feasible > 1:
            feasible = np.flatnonzero(evaluation.reason == 0)
            for scored in evaluation.scores:
                if scored.plugin.shadow and not scored.skipped:
                    share = np.array(evaluation.score_of(scored, feasible), dtype=np.int64)
                    total = evaluation.totals[feasible] + scored.plugin.weight * share
                    stays = total[np.searchsorted(feasible, chosen)] == total.max()
                    verdicts[scored.plugin.name] = verdicts.get(scored.plugin.name, False) or not stays
        for name, changed in verdicts.items():
            self._count(name, "shadow", "changed" if changed else "same")
        return tuple(sorted(name for name, changed in verdicts.items() if changed))

    def _shadow_refuses(self, column: FilterColumn, pod: PodInfo, row: int) -> bool | None:
        """Whether this filter would have rejected the row. None when it skips the pod, or fails."""
        try:
            bring_up([column], pod, Snapshot(self._cluster), column.position)
        except Exception:  # a shadow plugin must not hold a pod back; the log has the stack, the metric the count
            log.exception("shadow plugin %s failed for %s", column.plugin.name, pod.key)
            self._count(column.plugin.name, "shadow", "error")
            return None
        return None if column.skipped else bool(column.codes[row])

    def name_of(self, evaluation: Evaluation, position: int) -> str:
        """Node name at a position of an evaluation."""
        row = position if evaluation.rows is None else int(evaluation.rows[position])
        return self._cluster.nodes.names[row]

    def position_of(self, evaluation: Evaluation, name: str) -> int | None:
        """Position of a node by name, if it takes the pod."""
        row = self._cluster.nodes.row_of.get(name)
        if row is None:
            return None
        position = row
        if evaluation.rows is not None:
            found = np.flatnonzero(evaluation.rows == row)
            if not len(found):
                return None
            position = int(found[0])
        return position if evaluation.reason[position] == 0 else None

    def volume_plan(self, pod: PodInfo, node: str) -> VolumePlan | None:
        """What must be written about the pod's volumes before it may be bound to this node."""
        view = Snapshot(self._cluster, [self._cluster.nodes.row_of[node]])
        for loaded in self.profile.filters:
            plan = loaded.plan(pod, view) if loaded.plan is not None else None
            if plan is not None:
                return plan
        return None

    def claim_plan(self, pod: PodInfo, node: str) -> ClaimPlan | None:
        """Returns what must be written about the pod's resource claims before it may be bound to this node. Raises ValueError."""
        view = Snapshot(self._cluster, [self._cluster.nodes.row_of[node]])
        planner = self.profile.claim_planner
        return planner.plan_claims(pod, view) if planner is not None and planner.plan_claims is not None else None

    def check_aborts(self, pod: PodInfo, evaluation: Evaluation) -> None:
        """Raise the ValueError of a filter that found, on a node no other filter rejected, that the pod cannot be scheduled at all."""
        for code in evaluation.counts():
            if evaluation.reasons.values[code].texts == ABORTS:
                position = evaluation.examples(code)[0]
                name = evaluation.reasons.values[code].plugin
                try:
                    self.claim_plan(pod, self.name_of(evaluation, position))
                except ValueError as error:
                    raise ValueError(f'running "{name}" filter plugin: {error}') from error

    def remembered(self, pod: PodInfo, key: Hashable) -> dict[Any, Any]:
        """A dictionary in which a post_filter keeps results for pods of this class; the least recently used ones are dropped."""
        return self._results.remembered(pod, key) if self._caching else {}

    # --- Counting ------------------------------------------------------------------------------------------------

    def _count(self, plugin: str, point: str, result: str, pods: int = 1) -> None:
        key = (plugin, point, result)
        self._counts[key] = self._counts.get(key, 0) + pods

    def _count_filters(self, evaluation: Evaluation) -> None:
        filtered, codes = evaluation.tally.filtered, tuple(evaluation.counts())
        if len(filtered) > MOST_OUTCOMES:
            self._flush(evaluation)
        filtered[codes] = filtered.get(codes, 0) + 1

    def _flush(self, evaluation: Evaluation) -> None:
        tally = evaluation.tally
        for codes, pods in tally.filtered.items():
            rejecting = {self._results.reasons.values[code].plugin for code in codes}
            for column in evaluation.filters:
                name = column.plugin.name
                result = "skip" if column.skipped else "reject" if name in rejecting else "pass"
                self._count(name, "filter", result, pods)
        for scored in evaluation.scores if tally.scored else ():
            if not scored.skipped:
                self._count(scored.plugin.name, "score", "score", tally.scored)
        tally.filtered.clear()
        tally.scored = 0


def _nothing_left(plugins: list[str]) -> Status:
    several = len(plugins) > 1
    text = f"[{' '.join(plugins)}] simultaneously" if several else plugins[0]
    label = "plugin(s)" if several else "plugin"
    return Status(Code.UNRESOLVABLE, f"node(s) didn't satisfy {label} {text}", plugins[-1])


def pod_hash(uid: str, seed: int) -> int:
    """64 bits of a pod uid and the tie-break seed."""
    found = _begun(seed).copy()
    found.update(uid.encode())
    return _number(found.digest(), "little")


@cache
def _begun(seed: int) -> blake2b:
    return blake2b(f"{seed}/".encode(), digest_size=8)


_number: Final = int.from_bytes
