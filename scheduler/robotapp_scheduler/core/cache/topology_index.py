"""Everything that rules about other pods read: placed pods by labels, affinity terms, namespaces, Services, images."""

import numpy as np

from robotapp_scheduler.core.api.core_v1 import Namespace, Selecting
from robotapp_scheduler.core.cache.default_selectors import DefaultSelectors
from robotapp_scheduler.core.events.change_log import EVERY_ROW, ChangeLog
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.nodes.image_states import Images
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.selectors.affinity_index import AffinityIndex
from robotapp_scheduler.core.selectors.affinity_terms import Compiler, Namespaces, Terms
from robotapp_scheduler.core.selectors.label_sets import LabelSets
from robotapp_scheduler.core.selectors.pod_counts import Counter, PodCounts, Wanted
from robotapp_scheduler.core.selectors.topology_domains import Scopes


class Topology:
    """Counts of placed pods by selector and affinity term, and what the selectors and terms refer to."""

    def __init__(self, nodes: NodeTable, log: ChangeLog) -> None:
        self._nodes = nodes
        self._log = log
        self.label_sets = LabelSets()
        self._compiler = Compiler()
        self.namespaces = Namespaces()
        self.counts = PodCounts(self.label_sets, nodes.labels)
        self.affinity = AffinityIndex(nodes.labels, self.namespaces)
        self.selectors = DefaultSelectors()
        self.images = Images()
        self.scopes = Scopes()
        self._wide_position = -1
        """Where the change log stood when a pod last came or went with a term that reaches other nodes."""
        self._wide_before = -1
        """The same before the dry run began."""
        self._single: dict[str, tuple[int, bool]] = {}

    def __repr__(self) -> str:
        return f"Topology({self.counts!r}, {self.affinity!r}, {self.selectors!r})"

    # --- Placed pods, called by the cache ----------------------------------------------------------------------------

    def take(self, record: PlacedPod) -> None:
        """A pod is placed, on whatever node: from now on it shares labels and terms with its like."""
        record.label_set, new = self.label_sets.take(record.namespace, record.labels)
        record.labels = record.label_set.labels
        if new:
            self.counts.enrol(record.label_set)
        if record.affinity:
            terms = self._compiler.terms(record.namespace, record.affinity, record.pod.spec.affinity)
            record.terms = self.affinity.take(terms)

    def release(self, record: PlacedPod) -> None:
        """A pod is no longer placed."""
        if record.label_set is not None:
            self.label_sets.release(record.label_set)
        self.affinity.release(record.terms)

    def count(self, record: PlacedPod, row: int, sign: int) -> None:
        """Count a placed pod in (+1) or out (-1) on the row of its node."""
        if record.label_set is not None:
            self.counts.count(row, record.label_set, sign, ending=record.terminating)
        for placed in record.terms:
            placed.count(row, sign)
            if not self.single(placed.term.topology_key):
                self._wide_position = self._log.position

    def begin_dry_run(self) -> None:
        """From now on pods are moved only for a dry run of preemption."""
        self.counts.begin_dry_run()
        self._wide_before = self._wide_position

    def end_dry_run(self) -> None:
        """All moves are undone."""
        self.counts.end_dry_run()
        self._wide_position = self._wide_before

    # --- Read by the plugins ------------------------------------------------------------------------------------------

    def single(self, key: str) -> bool:
        """Does every value of this label belong to one node only, as kubernetes.io/hostname does?"""
        version = self._nodes.labels.version(key)
        known = self._single.get(key)
        if known is None or known[0] != version or not version:
            codes, vocabulary = self._nodes.labels.column(key)
            sizes = np.bincount(codes[codes > 0], minlength=len(vocabulary.values))
            known = self._single[key] = (self._nodes.labels.version(key), int(sizes.max(initial=0)) <= 1)
        return known[1]

    def no_wide_terms_since(self, position: int) -> bool:
        """Did no pod come or go, since this position of the change log, with a term whose domains are more than one node?

        False for a position of another log.
        """
        return self._wide_position < position <= self._log.position

    def terms_of(self, pod: PodInfo) -> Terms:
        """The pod's own affinity terms."""
        signature = pod.signature
        found: Terms | None = signature.notes.get(Terms)
        if found is None:
            found = signature.notes[Terms] = self._compiler.terms(pod.namespace, signature.affinity_key, pod.affinity)
        return found

    def counter(self, wanted: Wanted) -> Counter:
        """A counter of the placed pods that match a selector; kept up to date from now on."""
        return self.counts.counter(wanted, self._nodes.size)

    # --- What the watches show ---------------------------------------------------------------------------------------

    def apply_namespace(self, namespace: Namespace) -> Change:
        """A namespace appeared or changed."""
        return self._everywhere(Change.NAMESPACES, changed=self.namespaces.apply(namespace))

    def remove_namespace(self, namespace: Namespace) -> Change:
        """A namespace is gone."""
        return self._everywhere(Change.NAMESPACES, changed=self.namespaces.remove(namespace.metadata.name))

    def apply_selecting(self, kind: str, found: Selecting) -> Change:
        """A Service, ReplicationController, ReplicaSet or StatefulSet appeared or changed."""
        return self._everywhere(Change.SELECTORS, changed=self.selectors.apply(kind, found))

    def remove_selecting(self, kind: str, found: Selecting) -> Change:
        """A Service or workload is gone."""
        return self._everywhere(Change.SELECTORS, changed=self.selectors.remove(kind, found))

    def _everywhere(self, change: Change, *, changed: bool) -> Change:
        if not changed:
            return Change.NONE
        self._log.add(EVERY_ROW, change)
        return change
