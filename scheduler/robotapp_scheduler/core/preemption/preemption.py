"""DefaultPreemption's decision: on which node which pods of lower priority should go for a pod that fits nowhere.

It decides and deletes nothing. Nodes where only amounts count are compared by columns and whole numbers. Where another
filter depends on pods (affinity, ports, volumes), it runs again in a dry run without the victims.
"""

from collections.abc import Callable, Collection, Hashable, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import AdjustedSnapshot, Snapshot
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.explain.record import histogram
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.preemption.filter_dependencies import Influence
from robotapp_scheduler.core.preemption.victims import Candidate, by_amounts, by_dry_run, lower_pods
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import Codes

NOT_HELPFUL: Final = "Preemption is not helpful for scheduling"
NO_VICTIMS: Final = "No preemption victims found for incoming pod"
NEVER: Final = "not eligible due to preemptionPolicy=Never."
TERMINATING: Final = "not eligible due to a terminating pod on the nominated node."
BY_SCHEDULER: Final = "PreemptionByScheduler"


class Plan(NamedTuple):
    """These pods are to be evicted from this node, most important first."""

    node: str
    victims: tuple[PlacedPod, ...]
    violations: int


class Outcome(NamedTuple):
    """Result of a `post_filter`: the rest of the message, the node to wait for ("" = none any more, None = as before).

    The allocation of `deallocate` is to be taken back.
    """

    text: str
    nominate: str | None = None
    plan: Plan | None = None
    deallocate: ResourceClaim | None = None


NOTHING: Final = Outcome("")
"""Result of a `post_filter` that has nothing to do for the pod."""
Remembered = dict[int, tuple[int, Candidate | None, bool]]
"""Per row where no other node matters: (version of the row it was made of, victims, do filters depend on its pods of lower priority)."""


class Failure(NamedTuple):
    """An attempt that found no node. `evaluation` is None when a pre_filter rejected the pod."""

    cluster: Cache
    pod: PodInfo
    evaluation: Evaluation | None
    outside: int = 0
    """Nodes excluded by name before the filters."""
    offset: int = 0
    """Where the search begins: any number, equal for equal pods."""
    spared: frozenset[str] = frozenset()
    """Pods that are placed in the same cycle: no victims."""
    remembered: Callable[[Hashable], Remembered] = lambda _: {}
    """What is kept about pods of this class, by key."""


class Preemption:
    """One search. `limit(n)` is the number of candidates among n nodes after which it may stop."""

    def __init__(self, failure: Failure, limit: Callable[[int], int]) -> None:
        self._failure = failure
        self._cluster = failure.cluster
        self._pod = failure.pod
        self._limit = limit
        self._texts: dict[str, int] = {}

    def __repr__(self) -> str:
        return f"Preemption(for {self._pod.key})"

    def outcome(self) -> Outcome:
        """The node with its victims, or why there is none."""
        pod, cluster = self._pod, self._cluster
        if pod.pod.spec.preemption_policy == "Never":
            return Outcome(NEVER)
        evaluation = self._failure.evaluation
        if evaluation is None:
            return self._none(cluster.nodes.count)
        positions = resolvable(evaluation)
        if self._waits_for_victims(evaluation, positions):
            return Outcome(TERMINATING)
        helpless = self._failure.outside + int(np.count_nonzero(evaluation.reason > 0)) - len(positions)
        if not cluster.any_below(pod.priority):
            self._count_nodes(NO_VICTIMS, len(positions))
            return self._none(helpless)
        best = self._best(evaluation, positions)
        if best is None:
            return self._none(helpless)
        node, count = cluster.nodes.names[best.row], len(best.victims)
        text = f"found a potential placement for pod on node {node}, preempting {count} victims"
        return Outcome(text, node, Plan(node, best.victims, best.violations))

    def _none(self, helpless: int) -> Outcome:
        self._count_nodes(NOT_HELPFUL, helpless)
        return Outcome(histogram(self._cluster.nodes.count, self._texts), "")

    def _count_nodes(self, text: str, count: int) -> None:
        self._texts[text] = self._texts.get(text, 0) + count

    def _waits_for_victims(self, evaluation: Evaluation, positions: npt.NDArray[np.intp]) -> bool:
        """Do victims still terminate on the nominated node? False if that node cannot help any more."""
        node = self._cluster.nominations.node_of(self._pod.uid)
        row = self._cluster.nodes.row_of.get(node)
        if row is None or not evaluation.has(row):
            return False
        if not (positions == evaluation.positions(np.array([row]))[0]).any():
            return False
        return any(
            other.priority < self._pod.priority and _being_preempted(other) for other in self._cluster.pods_on(node)
        )

    # --- Candidates ----------------------------------------------------------------------------------------------

    def _best(self, evaluation: Evaluation, positions: npt.NDArray[np.intp]) -> Candidate | None:
        search = _Search(self._failure, evaluation, positions)
        found = search.candidates(self._limit(len(positions)))
        if found:
            return min(found, key=lambda candidate: candidate.rank)
        for text, count in search.texts().items():
            self._count_nodes(text, count)
        return None


class _Search:
    """The nodes on which taking pods away may help, in the order of the search."""

    def __init__(self, failure: Failure, evaluation: Evaluation, positions: npt.NDArray[np.intp]) -> None:
        self._cluster = cluster = failure.cluster
        self._pod = pod = failure.pod
        self._spared = failure.spared
        self._evaluation = evaluation
        self._influence = Influence(pod, evaluation)
        row_of = cluster.nodes.row_of
        nominated = cluster.nominations.at_least(pod.priority, but=pod.uid)
        self._held = {row_of[node]: records for node, records in nominated.items() if node in row_of}
        """Nominated pods of at least this priority, per row."""
        self._versions = cluster.nodes.versions
        start = failure.offset % max(len(positions), 1)
        order = np.concatenate([positions[start:], positions[:start]])
        self._rows: npt.NDArray[np.intp] = order if evaluation.rows is None else evaluation.rows[order]
        held = cluster.held_below(pod.priority)[:, self._rows]
        self._has_lower = held[0] > 0
        # As if every pod of lower priority were gone, where no other filter depends on them.
        view = AdjustedSnapshot(cluster, self._rows, -held[: len(cluster.nodes.resources.names) + 1])
        self._first: Codes
        self._room: Codes
        self._first, self._room = self._influence.codes(view, evaluation)
        self._beside = self._influence.beside(Snapshot(cluster))
        """Filters that can decide by the pods that stay on the node."""
        self._confined = [name for name, test in self._beside.items() if test.confined]
        """Those of them that depend on no other node: their results hold until the node changes."""
        self._rest, self._open = (
            self._influence.codes(view, evaluation, without=names)[0] if names else self._first
            for names in (self._beside, self._confined)
        )
        """As `_first`, without the filters of each."""
        self._reasons: dict[int, int] = {}
        key = (pod.priority, cluster.budgets.generation, cluster.topology.namespaces.generation, *self._confined)
        self._kept: Remembered = failure.remembered(key) if not failure.spared else {}

    def candidates(self, limit: int) -> list[Candidate]:
        """Up to `limit` nodes with their victims, more while each of them would break a budget."""
        found: list[Candidate] = []
        clean = False
        hopeful = self._has_lower & (self._room == 0)
        if len(self._influence.others) == len(self._beside):
            hopeful &= self._rest == 0
        open_ = self._open == 0
        indices = np.flatnonzero(hopeful)
        for i, row, is_open in zip(
            *(each.tolist() for each in (indices, self._rows[indices], open_[indices])), strict=True
        ):
            kept = self._kept.get(row)
            if is_open and kept is not None and kept[0] == self._versions[row] and row not in self._held:
                candidate = kept[1]
            else:
                candidate = self._look(i, row)
            if candidate is None:
                continue
            found.append(candidate)
            clean = clean or not candidate.violations
            if clean and len(found) >= limit:
                break
        return found

    def texts(self) -> dict[str, int]:
        """Why the nodes are no candidates, after `candidates` found none."""
        counts: dict[int, int] = {}
        result: dict[str, int] = {}
        empty = int(np.count_nonzero(~self._has_lower))
        if empty:
            result[NO_VICTIMS] = empty
        for i in np.flatnonzero(self._has_lower).tolist():
            code = self._reasons.get(i)
            if code is None:
                code = self._reason_without(i)
            counts[code] = counts.get(code, 0) + 1
        for code, count in counts.items():
            for text in self._evaluation.reasons.values[code].texts:
                result[text] = result.get(text, 0) + count
        return result

    def _look(self, i: int, row: int) -> Candidate | None:
        nominated = self._held.get(row, ())
        if nominated:
            if self._touched(row) or any(self._influence.touched(record) for record in nominated):
                return self._by_dry_run(i, row, nominated)
            return self._by_amounts_alone(row, nominated=nominated) if self._first[i] == 0 else None
        if self._touched(row, without=self._beside):
            return self._by_dry_run(i, row, ())
        touched = bool(self._beside) and self._touched(row)
        if (self._rest if touched else self._first)[i] != 0:
            return None
        candidate = self._by_amounts_alone(row, fits=partial(self._fits, row) if touched else None)
        if not touched or not self._touched(row, without=self._confined):
            self._kept[row] = (self._versions[row], candidate, touched)
        return candidate

    def _fits(self, row: int, staying: Sequence[PlacedPod]) -> bool:
        return all(test.takes(row, staying) for test in self._beside.values())

    def _touched(self, row: int, *, without: Collection[str] = ()) -> bool:
        """Do other filters depend on the pods of lower priority of a row?"""
        kept = self._kept.get(row)
        if kept is not None and kept[0] == self._versions[row]:
            return kept[2] and not without
        if self._influence.room is None or not self._influence.others:
            return self._influence.room is None
        priority, spared = self._pod.priority, self._spared
        return any(
            self._influence.touched(pod, without=without)
            for pod in self._cluster.pods_on(self._cluster.nodes.names[row])
            if pod.priority < priority and pod.uid not in spared
        )

    def _by_amounts_alone(
        self,
        row: int,
        *,
        nominated: Sequence[PlacedPod] = (),
        fits: Callable[[Sequence[PlacedPod]], bool] | None = None,
    ) -> Candidate | None:
        lower = lower_pods(self._cluster, row, self._pod.priority, self._spared)
        room = self._influence.room
        requested = room.room(self._pod) if room is not None and room.room is not None else {}
        return by_amounts(self._cluster, row, lower, requested, nominated=nominated, fits=fits)

    def _by_dry_run(self, i: int, row: int, nominated: Sequence[PlacedPod]) -> Candidate | None:
        lower = lower_pods(self._cluster, row, self._pod.priority, self._spared)
        found = by_dry_run(self._cluster, self._influence, row, lower, nominated) if lower else 0
        if isinstance(found, Candidate):
            return found
        self._reasons[i] = found
        return None

    def _reason_without(self, i: int) -> int:
        """Reason against a node without its pods of lower priority: amounts, or the pods nominated there."""
        row = int(self._rows[i])
        nominated = self._held.get(row, ())
        if not nominated and not self._touched(row):
            return int(self._first[i])
        if not nominated and not self._touched(row, without=self._beside) and self._fits(row, self._staying(row)):
            return int(self._rest[i])
        self._by_dry_run(i, row, nominated)
        return self._reasons.get(i, 0)

    def _staying(self, row: int) -> list[PlacedPod]:
        going = {pod.uid for pod in lower_pods(self._cluster, row, self._pod.priority, self._spared)}
        return [pod for pod in self._cluster.pods_on(self._cluster.nodes.names[row]) if pod.uid not in going]


def resolvable(evaluation: Evaluation) -> npt.NDArray[np.intp]:
    """Positions of refused nodes where taking pods away may help."""
    helps = np.array([value.resolvable for value in evaluation.reasons.values])
    return np.flatnonzero((evaluation.reason > 0) & helps[np.maximum(evaluation.reason, 0)])


def preempt(failure: Failure, limit: Callable[[int], int]) -> Outcome:
    """The `post_filter` of DefaultPreemption, with its text's prefix."""
    found = Preemption(failure, limit).outcome()
    return found._replace(text=f"preemption: {found.text}")


def _being_preempted(record: PlacedPod) -> bool:
    if not record.terminating:
        return False
    found = next((each for each in record.pod.status.conditions or () if each.type == "DisruptionTarget"), None)
    return found is not None and (found.status, found.reason) == ("True", BY_SCHEDULER)
