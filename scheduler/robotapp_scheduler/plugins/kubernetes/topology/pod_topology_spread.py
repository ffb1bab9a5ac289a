"""PodTopologySpread: keep the pods of a selector even over zones, nodes or any other node label."""

from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import NODE, PLACED, Change, Event
from robotapp_scheduler.core.framework.incremental import AmongResult, Beside, Positions
from robotapp_scheduler.core.framework.interface import MAX_SCORE, FilterResult, Verdict
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.selectors.label_sets import LabelSet
from robotapp_scheduler.core.selectors.topology_domains import Scope
from robotapp_scheduler.plugins.kubernetes.common.arguments import QUALIFIED
from robotapp_scheduler.plugins.kubernetes.topology.spread_constraints import (
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

SYSTEM: Final = ("System", "")
"""Values of `defaultingType` that stand for the system's default constraints."""
UNEVEN: Final = "node(s) didn't match pod topology spread constraints"
REASONS: Final = ((UNEVEN,), (UNEVEN,), (f"{UNEVEN} (missing required label)",))
RESOLVABLE: Final = (True, True, False)
_MISSING: Final = 2
"""Index of REASONS for a node without the label. Index 1 is True of the comparison with the allowed skew."""
MOST_KNOWN: Final = 4096
MOST_SUMS: Final = 4096
COME_OR_GONE: Final = Change.POD_ADDED | Change.POD_REMOVED | Change.NOMINATED


class SpreadArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """Constraints of pods that have none: those of Kubernetes with defaultingType System, defaultConstraints with List."""

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
    relevant_reads = ("selectors",)
    events = NODE | PLACED | Change.LABELS | Change.TAINTS | Change.NOMINATED
    hint_reads = ("namespace", "spread", "spread_labels")
    Args = SpreadArgs

    def __init__(self, args: SpreadArgs | None = None) -> None:
        args = args or SpreadArgs()
        self._system = args.defaulting_type in SYSTEM
        self._defaults: Sequence[DefaultConstraint] = SYSTEM_DEFAULTS if self._system else args.default_constraints
        self._default_whens = {default.when_unsatisfiable for default in self._defaults}
        self._known: dict[tuple[object, ...], tuple[Constraint, ...]] = {}

    # --- Filter ------------------------------------------------------------------------------------------------------

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """Where the pod would not make the spread of a DoNotSchedule constraint more uneven than it may be."""
        constraints = self._constraints(pod, nodes, HARD)
        if not constraints:
            return None if pod.pod.spec.topology_spread_constraints or HARD not in self._default_whens else True
        keys = _keys(constraints)
        found = [(_reason_codes(each, pod, nodes, keys), nodes.label(each.key)) for each in constraints]
        if len(found) == 1:
            codes, label = found[0]
            return Verdict(codes == 0, codes=codes, reasons=REASONS, resolvable=RESOLVABLE, label=label)
        codes = np.zeros(nodes.n, dtype=np.int8)
        for verdicts, label in found:
            np.copyto(codes, verdicts[label.codes], where=codes == 0)
        return Verdict(codes == 0, codes=codes, reasons=REASONS, resolvable=RESOLVABLE)

    def touched_by(self, pod: PodInfo, other: PlacedPod) -> bool:
        """Does a DoNotSchedule constraint count the other pod?"""
        if not pod.pod.spec.topology_spread_constraints:
            return True
        return any(
            constraint.wanted.matchers[0].matches(other.namespace, other.labels) for constraint in self._own(pod, HARD)
        )

    def beside(self, pod: PodInfo, nodes: Snapshot) -> Beside:
        """Where the counts without those that go are even enough."""
        constraints = self._constraints(pod, nodes, HARD)
        keys = _keys(constraints)
        counted = [_Counted(each, nodes, scope_of(pod, nodes, each, keys)) for each in constraints]

        def takes(row: int, staying: Sequence[PlacedPod]) -> bool:
            there = nodes.cluster.pods_on(nodes.names[row])
            return all(each.takes(row, there, staying) for each in counted)

        return Beside(takes, confined=False)

    # --- Score -------------------------------------------------------------------------------------------------------

    def relevant(self, pod: PodInfo, nodes: Snapshot) -> bool:
        """Are there constraints to score by?"""
        return bool(self._constraints(pod, nodes, SOFT))

    def score_among(self, pod: PodInfo, nodes: Snapshot, feasible: Positions) -> AmongResult:
        """Fewer matching pods in a node's domains are better; weights grow with the number of domains in view."""
        constraints = self._constraints(pod, nodes, SOFT)
        if not constraints:
            return 0
        soft = _Soft(constraints, bool(pod.pod.spec.topology_spread_constraints) or not self._system)
        columns = {c.key: _taken(nodes.label(c.key).codes, feasible) for c in constraints}
        counted: BoolArray | None = None
        if soft.strict and not all(codes.all() for codes in columns.values()):
            counted = np.logical_and.reduce([codes != 0 for codes in columns.values()])
        burdens = [_burden(c, pod, nodes, soft, _View(feasible, columns[c.key], counted)) for c in constraints]
        return _normalized(_added(burdens), counted)

    # --- Queueing ----------------------------------------------------------------------------------------------------

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """Pods that a constraint counts came, went or changed; or nodes with its keys did."""
        if not pod.pod.spec.topology_spread_constraints:
            return True  # default constraints: which pods count depends on Services and owners
        constraints = self._own(pod, HARD)
        if event.resource == "nodes":
            return _nodes_matter(event.old, event.new, constraints)
        pods: list[Pod] = [each for each in (event.old, event.new) if each is not None]
        counted = [tuple(constraint.matches(each) for constraint in constraints) for each in pods]
        if event.change & COME_OR_GONE or len(pods) == 1:
            return any(map(any, counted))
        if event.change & Change.SELF:
            tolerates_more = pods[0].spec.tolerations != pods[1].spec.tolerations
            return counted[0] != counted[1] or (tolerates_more and any(each.honor_taints for each in constraints))
        ends = (pods[0].metadata.deletion_timestamp is None) != (pods[1].metadata.deletion_timestamp is None)
        return counted[0] != counted[1] or (ends and any(counted[1]))

    # --- Inside ------------------------------------------------------------------------------------------------------

    def _constraints(self, pod: PodInfo, nodes: Snapshot, when: str) -> tuple[Constraint, ...]:
        if not pod.pod.spec.topology_spread_constraints:
            return self._default(pod, nodes, when) if when in self._default_whens else ()
        return self._own(pod, when)

    def _default(self, pod: PodInfo, nodes: Snapshot, when: str) -> tuple[Constraint, ...]:
        requirements = nodes.cluster.topology.selectors.of(pod)
        if not requirements:
            return ()
        known = pod.signature.notes.get((self, when))
        if known is None or known[0] is not requirements:
            found = default_constraints(pod, when, self._defaults, requirements)
            known = pod.signature.notes[self, when] = (requirements, found)
        constraints: tuple[Constraint, ...] = known[1]
        return constraints

    def _own(self, pod: PodInfo, when: str) -> tuple[Constraint, ...]:
        key = (when, pod.features(("labels", "namespace", "spread")))
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            found = self._known[key] = own_constraints(pod, when)
        return found


class _View(NamedTuple):
    """The feasible nodes as one constraint sees them: codes of its label, and which nodes count (None = all)."""

    feasible: Positions
    codes: npt.NDArray[np.int32]
    counted: BoolArray | None


class _Burden(NamedTuple):
    """What one constraint has against each feasible node: an entry of a table that may be much smaller."""

    table: FloatArray
    which: npt.NDArray[np.integer[Any]]


class _Raw(NamedTuple):
    """The same for all constraints, rounded."""

    table: IntArray
    which: npt.NDArray[np.integer[Any]] | None
    """None: the table has an entry per node."""


class _Counted:
    """One DoNotSchedule constraint, reckoned for single nodes of which some pods go."""

    def __init__(self, constraint: Constraint, nodes: Snapshot, scope: Scope) -> None:
        domains = constraint.counter(nodes).domains(constraint.key, scope)
        self._constraint = constraint
        self._scope = scope
        self._codes = nodes.label(constraint.key).codes
        self._values = domains.values
        self._present = frozenset(domains.present.tolist())
        self._lowest = sorted((int(domains.values[code]), code) for code in self._present)[:2]
        """The two lowest counts and where they are."""
        self._known: dict[LabelSet | None, bool] = {}

    def takes(self, row: int, there: Iterable[PlacedPod], staying: Iterable[PlacedPod]) -> bool:
        """Is the spread even enough with the pod on this row, when of the pods there just these stay?"""
        constraint, code = self._constraint, int(self._codes[row])
        if code == 0:
            return False
        count = int(self._values[code])
        if self._scope.mask[row]:
            count -= self._matching(there) - self._matching(staying)
        lowest = 0
        if 0 < len(self._present) >= constraint.min_domains:
            others = [value for value, other in self._lowest if other != code]
            lowest = min([count, *others] if code in self._present else others)
        return count <= constraint.max_skew - constraint.self_match + lowest

    def _matching(self, pods: Iterable[PlacedPod]) -> int:
        """How many it counts; as upstream's dry runs, terminating ones too."""
        return sum(self._matches(pod) for pod in pods)

    def _matches(self, pod: PlacedPod) -> bool:
        found = self._known.get(pod.label_set)
        if found is None:
            matcher = self._constraint.wanted.matchers[0]
            found = self._known[pod.label_set] = matcher.matches(pod.namespace, pod.labels)
        return found


def _keys(constraints: Sequence[Constraint]) -> tuple[str, ...]:
    """The labels they name, each once."""
    return (constraints[0].key,) if len(constraints) == 1 else tuple(dict.fromkeys([each.key for each in constraints]))


def _reason_codes(constraint: Constraint, pod: PodInfo, nodes: Snapshot, keys: tuple[str, ...]) -> npt.NDArray[np.int8]:
    """Index of REASONS per code of the label, 0 where the node passes."""
    domains = constraint.counter(nodes).domains(constraint.key, scope_of(pod, nodes, constraint, keys))
    present = domains.present
    lowest = int(np.minimum.reduce(domains.values[present])) if 0 < len(present) >= constraint.min_domains else 0
    uneven = domains.values > constraint.max_skew - constraint.self_match + lowest
    found = uneven.view(np.int8)
    found[0] = _MISSING
    return found


def _burden(constraint: Constraint, pod: PodInfo, nodes: Snapshot, soft: _Soft, view: _View) -> _Burden:
    """Count · ln(domains + 2) + maxSkew - 1 per feasible node; 0 where the label is absent."""
    counter = constraint.counter(nodes)
    if constraint.key == HOSTNAME:
        counts = _taken(nodes.pick(counter.column), view.feasible)
        size = len(view.feasible) if view.counted is None else int(np.count_nonzero(view.counted))
        most = int(counts.max(initial=0))
        table = np.arange(most + 2, dtype=np.int64) * np.log(float(size + 2)) + float(constraint.max_skew - 1)
        table[most + 1] = 0.0  # for nodes without the label
        return _Burden(table, counts if view.codes.all() else np.where(view.codes == 0, most + 1, counts))
    keys = _keys(soft.constraints) if soft.strict else ()
    values = counter.domains(constraint.key, scope_of(pod, nodes, constraint, keys)).values
    seen = np.bincount(view.codes if view.counted is None else view.codes[view.counted], minlength=len(values)) > 0
    size = int(np.count_nonzero(seen))
    empty = nodes.label(constraint.key).vocabulary.codes.get("")
    if empty is not None and not soft.strict:
        # Upstream takes a label without a value for an absent one when it counts.
        size -= int(seen[empty] and seen[0])
        values = values.copy()
        values[empty] += values[0]
    per_domain: FloatArray = values * np.log(float(size + 2)) + float(constraint.max_skew - 1)
    per_domain[0] = 0.0
    return _Burden(per_domain, view.codes)


def _added(burdens: Sequence[_Burden]) -> _Raw:
    """All burdens of a node added up and rounded; halves are rounded up: nothing here is negative.

    Few different counts in few domains make few different sums: those are reckoned with, and looked up per node.
    """
    total: FloatArray = burdens[0].table
    index: npt.NDArray[np.integer[Any]] | None = burdens[0].which
    for table, other in burdens[1:]:
        if index is not None and len(total) * len(table) <= MOST_SUMS:
            total = np.add.outer(total, table).ravel()
            index = index * np.int64(len(table)) + other
        else:
            total = (total if index is None else total[index]) + table[other]
            index = None
    raw = np.floor(total)
    raw += total - raw >= 0.5
    return _Raw(raw.astype(np.int64), index)


def _normalized(raw: _Raw, counted: BoolArray | None) -> IntArray | int:
    """100·(max + min - s) // max over the nodes that count, 0 for the others."""
    scores = raw.table if raw.which is None else raw.table[raw.which]
    scored = scores if counted is None else scores[counted]
    if not len(scored):
        return 0
    low, top = int(scored.min()), int(scored.max())
    if top == 0:
        return MAX_SCORE if counted is None else np.where(counted, MAX_SCORE, 0)
    table: IntArray = MAX_SCORE * (top + low - raw.table) // top
    found: IntArray = table if raw.which is None else table[raw.which]
    return found if counted is None else np.where(counted, found, 0)


def _taken(column: npt.NDArray[Any], positions: Positions) -> npt.NDArray[Any]:
    return column if len(positions) == len(column) else column[positions]


def _nodes_matter(old: Node | None, new: Node | None, constraints: Sequence[Constraint]) -> bool:
    """Did a node with all keys come or go, or change its domains or its taints?"""
    before, after = _domains(old, constraints), _domains(new, constraints)
    if old is None or new is None or before is None or after is None:
        return before != after
    return before != after or old.spec.taints != new.spec.taints


def _domains(node: Node | None, constraints: Sequence[Constraint]) -> list[str] | None:
    """The node's domain per constraint; None for one that is not there or lacks a key."""
    labels = (node.metadata.labels or {}) if node is not None else {}
    found = [labels[c.key] for c in constraints if c.key in labels]
    return found if node is not None and len(found) == len(constraints) else None


def _problems(args: SpreadArgs) -> list[str]:
    """The problems that upstream's validation reports."""
    found = []
    if args.defaulting_type not in (*SYSTEM, "List"):
        found.append(f'defaultingType: Unsupported value: "{args.defaulting_type}": supported values: "System", "List"')
    elif args.defaulting_type in SYSTEM and args.default_constraints:
        found.append('defaultingType: Invalid value: "System": when .defaultConstraints are not empty')
    seen: set[tuple[str, str]] = set()
    for i, constraint in enumerate(args.default_constraints):
        path = f"defaultConstraints[{i}]"
        when = constraint.when_unsatisfiable
        if constraint.max_skew <= 0:
            found.append(f"{path}.maxSkew: Invalid value: {constraint.max_skew}: not in valid range (0, inf)")
        key = constraint.topology_key
        if not key:
            found.append(f"{path}.topologyKey: Required value: can not be empty")
        elif QUALIFIED.fullmatch(key) is None:
            found.append(f'{path}.topologyKey: Invalid value: "{key}": must be a label name such as example.com/rack')
        if when not in {HARD, SOFT}:
            wrong = f'Unsupported value: "{when}": supported values: "{HARD}", "{SOFT}"'
            found.append(f"{path}.whenUnsatisfiable: {wrong if when else 'Required value: can not be empty'}")
        if constraint.label_selector is not None:
            text = "constraint must not define a selector, as they deduced for each pod"
            found.append(f"{path}.labelSelector: Forbidden: {text}")
        if (key, when) in seen:
            found.append(f'{path}: Duplicate value: "{{{key}, {when}}}"')
        seen.add((key, when))
    return found
