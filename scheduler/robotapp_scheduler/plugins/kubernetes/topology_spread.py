"""PodTopologySpread: keep the pods of a selector even over zones, nodes or any other node label."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.changes import NODE, PLACED, Change, Event
from robotapp_scheduler.core.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.framework import MAX_SCORE, AmongResult, FilterResult, Positions, Verdict
from robotapp_scheduler.core.objects import Node
from robotapp_scheduler.core.pods import PlacedPod, PodInfo
from robotapp_scheduler.core.view import Nodes
from robotapp_scheduler.plugins.kubernetes.spread_constraints import (
    HARD,
    HOSTNAME,
    PLUGIN,
    SOFT,
    SYSTEM_DEFAULTS,
    Constraint,
    DefaultConstraint,
    default_constraints,
    own_constraints,
    scope_of,
)

UNEVEN: Final = "node(s) didn't match pod topology spread constraints"
REASONS: Final = ((UNEVEN,), (UNEVEN,), (f"{UNEVEN} (missing required label)",))
RESOLVABLE: Final = (True, True, False)
_UNEVEN: Final = 1
_MISSING: Final = 2
MOST_KNOWN: Final = 4096
COME_OR_GONE: Final = Change.POD_ADDED | Change.POD_REMOVED | Change.NOMINATED


class SpreadArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """Constraints for pods without any: the system's, or (defaultingType List) these."""

    default_constraints: tuple[DefaultConstraint, ...] = ()
    defaulting_type: str = "System"

    def __post_init__(self) -> None:
        if problems := _problems(self):
            raise ValueError("; ".join(problems))


class _Soft(NamedTuple):
    """Constraints to score by. `strict`: nodes without all keys are left out."""

    constraints: tuple[Constraint, ...]
    strict: bool


class PodTopologySpread:
    """Counts per topology domain are kept by the cluster; a pod costs one look-up per node and constraint."""

    name = PLUGIN
    reads = ("controller", "labels", "namespace", "node_affinity", "node_selector", "spread", "tolerations")
    node_reads = ("labels", "pods", "selectors", "taints")
    events = NODE | PLACED | Change.LABELS | Change.TAINTS | Change.NOMINATED
    hint_reads = ("labels", "namespace", "spread")
    Args = SpreadArgs

    def __init__(self, args: SpreadArgs | None = None) -> None:
        args = args or SpreadArgs()
        self._system = args.defaulting_type == "System"
        self._defaults: Sequence[DefaultConstraint] = SYSTEM_DEFAULTS if self._system else args.default_constraints
        self._default_whens = {default.when_unsatisfiable for default in self._defaults}
        self._known: dict[tuple[object, ...], tuple[Constraint, ...]] = {}

    # --- Filter ------------------------------------------------------------------------------------------------------

    def filter(self, pod: PodInfo, nodes: Nodes) -> FilterResult:
        """Where the pod would not make the spread of a DoNotSchedule constraint more uneven than it may be."""
        constraints = self._constraints(pod, nodes, HARD)
        if not constraints:
            return None if pod.pod.spec.topology_spread_constraints or HARD not in self._default_whens else True
        keys = tuple(dict.fromkeys(constraint.key for constraint in constraints))
        codes: npt.NDArray[np.int8] | None = None
        for constraint in constraints:
            found = _verdicts(constraint, pod, nodes, keys)[nodes.label(constraint.key).codes]
            codes = found if codes is None else np.where(codes == 0, found, codes)
        assert codes is not None  # noqa: S101 - there is at least one constraint
        return Verdict(codes == 0, codes=codes, reasons=REASONS, resolvable=RESOLVABLE)

    def touched_by(self, pod: PodInfo, other: PlacedPod) -> bool:
        """Does a DoNotSchedule constraint count the other pod?"""
        if not pod.pod.spec.topology_spread_constraints:
            return True
        return any(
            constraint.wanted.matchers[0].matches(other.namespace, other.labels) for constraint in self._own(pod, HARD)
        )

    # --- Score -------------------------------------------------------------------------------------------------------

    def relevant(self, pod: PodInfo, nodes: Nodes) -> bool:
        """Are there constraints to score by?"""
        return bool(self._constraints(pod, nodes, SOFT))

    def score_among(self, pod: PodInfo, nodes: Nodes, feasible: Positions) -> AmongResult:
        """Fewer matching pods in a node's domains are better; weights grow with the number of domains in view."""
        constraints = self._constraints(pod, nodes, SOFT)
        if not constraints:
            return 0
        soft = _Soft(constraints, bool(pod.pod.spec.topology_spread_constraints) or not self._system)
        columns = {c.key: _taken(nodes.label(c.key).codes, feasible) for c in constraints}
        counted = np.ones(len(feasible), dtype=np.bool_)
        if soft.strict:
            for codes in columns.values():
                counted &= codes != 0
        total: FloatArray = np.zeros(len(feasible))
        for constraint in constraints:
            total += _burden(constraint, pod, nodes, soft, _View(feasible, columns[constraint.key], counted))
        raw = np.floor(total)
        raw += total - raw >= 0.5  # halves are rounded up: nothing here is negative
        return _normalized(raw.astype(np.int64), counted)

    # --- Queueing ----------------------------------------------------------------------------------------------------

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """Pods that a constraint counts came, went or changed; or nodes with its keys did."""
        if not pod.pod.spec.topology_spread_constraints:
            return True  # default constraints: which pods count depends on Services and owners
        constraints = own_constraints(pod, HARD)
        if event.resource == "nodes":
            return _nodes_matter(event.old, event.new, constraints)
        pods = [PodInfo(each) for each in (event.old, event.new) if each is not None]
        counted = [tuple(constraint.matches(each) for constraint in constraints) for each in pods]
        if event.change & COME_OR_GONE or len(pods) == 1:
            return any(map(any, counted))
        if event.change & Change.SELF:
            tolerates_more = pods[0].tolerations != pods[1].tolerations
            return counted[0] != counted[1] or (tolerates_more and any(each.honor_taints for each in constraints))
        return counted[0] != counted[1] or (pods[0].deleting != pods[1].deleting and any(counted[1]))

    # --- Inside ------------------------------------------------------------------------------------------------------

    def _constraints(self, pod: PodInfo, nodes: Nodes, when: str) -> tuple[Constraint, ...]:
        if not pod.pod.spec.topology_spread_constraints:
            if when not in self._default_whens:
                return ()
            requirements = nodes.cluster.topology.selectors.of(pod)
            return default_constraints(pod, when, self._defaults, requirements) if requirements else ()
        return self._own(pod, when)

    def _own(self, pod: PodInfo, when: str) -> tuple[Constraint, ...]:
        key = (when, pod.features(("labels", "namespace", "spread")))
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            found = self._known[key] = own_constraints(pod, when)
        return found


class _View(NamedTuple):
    """The feasible nodes as one constraint sees them."""

    feasible: Positions
    codes: npt.NDArray[np.int32]
    counted: BoolArray


def _verdicts(constraint: Constraint, pod: PodInfo, nodes: Nodes, keys: tuple[str, ...]) -> npt.NDArray[np.int8]:
    """What to say about a node, per code of its label: 0 fine, else an index of REASONS."""
    domains = constraint.counter(nodes).domains(constraint.key, scope_of(pod, nodes, constraint, keys))
    present = domains.present
    lowest = int(domains.values[present].min()) if 0 < len(present) >= constraint.min_domains else 0
    uneven = domains.values > constraint.max_skew - constraint.self_match + lowest
    found = uneven.astype(np.int8)  # _UNEVEN where True
    found[0] = _MISSING
    return found


def _burden(constraint: Constraint, pod: PodInfo, nodes: Nodes, soft: _Soft, view: _View) -> FloatArray:
    """Count · ln(domains + 2) + maxSkew - 1 per feasible node; 0 where the label is absent."""
    counter = constraint.counter(nodes)
    if constraint.key == HOSTNAME:
        counts = _taken(nodes.pick(counter.column), view.feasible)
        size = int(np.count_nonzero(view.counted)) if soft.strict else len(view.feasible)
        burden: FloatArray = counts * np.log(float(size + 2)) + float(constraint.max_skew - 1)
        return np.where(view.codes == 0, 0.0, burden)
    keys = tuple(dict.fromkeys(each.key for each in soft.constraints)) if soft.strict else ()
    values = counter.domains(constraint.key, scope_of(pod, nodes, constraint, keys)).values
    seen = np.bincount(view.codes if not soft.strict else view.codes[view.counted], minlength=len(values)) > 0
    size = int(np.count_nonzero(seen))
    empty = nodes.label(constraint.key).vocabulary.codes.get("")
    if empty is not None and not soft.strict:
        # Upstream takes a label without a value for an absent one when it counts.
        size -= int(seen[empty] and seen[0])
        values = values.copy()
        values[empty] += values[0]
    per_domain: FloatArray = values * np.log(float(size + 2)) + float(constraint.max_skew - 1)
    per_domain[0] = 0.0
    return per_domain[view.codes]


def _normalized(raw: IntArray, counted: BoolArray) -> IntArray | int:
    """100·(max + min - s) // max over the nodes that count, 0 for the others."""
    every = bool(counted.all())
    scored = raw if every else raw[counted]
    if not len(scored):
        return 0
    low, top = int(scored.min()), int(scored.max())
    if top == 0:
        return MAX_SCORE if every else np.where(counted, MAX_SCORE, 0)
    found: IntArray = MAX_SCORE * (top + low - raw) // top
    return found if every else np.where(counted, found, 0)


def _taken(column: npt.NDArray[Any], positions: Positions) -> npt.NDArray[Any]:
    return column if len(positions) == len(column) else column[positions]


def _nodes_matter(old: Node | None, new: Node | None, constraints: Sequence[Constraint]) -> bool:
    labels = [(node.metadata.labels or {}) if node is not None else None for node in (old, new)]
    matching = [found is not None and all(c.key in found for c in constraints) for found in labels]
    if old is None or new is None:
        return any(matching)
    before, after = labels[0] or {}, labels[1] or {}
    changed = any(before.get(c.key) != after.get(c.key) for c in constraints)
    return matching[0] != matching[1] or (matching[1] and (changed or old.spec.taints != new.spec.taints))


def _problems(args: SpreadArgs) -> list[str]:
    """What upstream's validation would say."""
    found = []
    if args.defaulting_type not in {"System", "List"}:
        found.append(f'defaultingType: Unsupported value: "{args.defaulting_type}": supported values: "List", "System"')
    elif args.defaulting_type == "System" and args.default_constraints:
        found.append('defaultingType: Invalid value: "System": when .defaultConstraints are not empty')
    seen: set[tuple[str, str]] = set()
    for i, constraint in enumerate(args.default_constraints):
        path = f"defaultConstraints[{i}]"
        when = constraint.when_unsatisfiable
        if constraint.max_skew <= 0:
            found.append(f"{path}.maxSkew: Invalid value: {constraint.max_skew}: not in valid range (0, inf)")
        if not constraint.topology_key:
            found.append(f"{path}.topologyKey: Required value: can not be empty")
        if when not in {HARD, SOFT}:
            wrong = f'Unsupported value: "{when}": supported values: "{HARD}", "{SOFT}"'
            found.append(f"{path}.whenUnsatisfiable: {wrong if when else 'Required value: can not be empty'}")
        if constraint.label_selector is not None:
            text = "constraint must not define a selector, as they deduced for each pod"
            found.append(f"{path}.labelSelector: Forbidden: {text}")
        if (constraint.topology_key, when) in seen:
            found.append(f'{path}: Duplicate value: "{{{constraint.topology_key}, {when}}}"')
        seen.add((constraint.topology_key, when))
    return found
