"""Spread and pod affinity as columns against the scalar reference: in one cluster, and along a history of it.

The families of e2e/campaigns/cluster_cases are what a cluster may hold; here labels are odd, selectors blank, and
columns are repaired after every change.
"""

from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.property.core.reference import topology_worlds as worlds
from tests.support.scheduling import make_core, to_pod
from tests.support.seeds import count_examples

from campaigns.reference_scheduler import ClusterDump, Config, decide
from campaigns.reference_scheduler.comparison import compare, feed
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PodInfo

Json = dict[str, Any]
SETTINGS = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large]}


def unequal(core: SchedulerCore, cluster: ClusterDump, pod: Json) -> list[str]:
    return compare(core, PodInfo(to_pod(pod)), decide(cluster, pod, Config()))


def core_of(cluster: ClusterDump) -> SchedulerCore:
    core = make_core()
    for kind, items in cluster.objects().items():
        for item in items:
            feed(core, kind, item)
    return core


@settings(max_examples=count_examples(200), **SETTINGS)
@given(worlds.worlds())
def test_decisions_in_odd_clusters_equal_the_reference(case: tuple[ClusterDump, Json]) -> None:
    cluster, pod = case
    assert unequal(core_of(cluster), cluster, pod) == []


STEPS = st.one_of(
    st.tuples(st.just("pod"), st.integers(0, 5), st.sampled_from(worlds.NAMES)),
    st.tuples(st.just("end"), st.integers(0, 5)),
    st.tuples(st.just("ending"), st.integers(0, 5)),
    st.tuples(st.just("node"), st.sampled_from(worlds.NAMES).flatmap(worlds.nodes)),
    st.tuples(st.just("gone"), st.sampled_from(worlds.NAMES)),
    st.tuples(st.just("namespace"), st.sampled_from(("default", "other")), st.sampled_from(("a", "b"))),
)


@settings(max_examples=count_examples(100), **SETTINGS)
@given(
    worlds.worlds(),
    st.lists(worlds.pods("more", node="n0"), min_size=6, max_size=6),
    st.lists(worlds.pods("q"), min_size=1, max_size=2),
    st.lists(STEPS, max_size=12),
)
def test_repaired_columns_equal_the_reference_after_any_history(
    case: tuple[ClusterDump, Json], pool: list[Json], others: list[Json], history: list[tuple[Any, ...]]
) -> None:
    cluster, pod = case
    past = History(cluster, pool)
    for step in history:
        past.take(step)
        for asking in (pod, *others) if past.cluster.nodes else ():
            assert unequal(past.core, past.cluster, asking) == []


class History:
    """A core and the plain JSON of the same cluster, changed together."""

    def __init__(self, cluster: ClusterDump, pool: list[Json]) -> None:
        self.core = core_of(cluster)
        self.cluster = cluster
        self._pool = pool

    def take(self, step: tuple[Any, ...]) -> None:
        match step:
            case ("pod", int(number), str(node)):
                raw = self._pool[number]
                meta = {**raw["metadata"], "name": f"more{number}", "uid": f"more{number}"}
                self._put("Pod", {**raw, "metadata": meta, "spec": {**raw["spec"], "nodeName": node}})
            case ("end", int(number)):
                self._take("Pod", f"more{number}")
            case ("ending", int(number)):
                old = self._at("Pod", f"more{number}")
                if old is not None:
                    meta = {**old["metadata"], "deletionTimestamp": "2026-01-01T00:00:00Z"}
                    self._put("Pod", {**old, "metadata": meta})
            case ("node", dict(node)):
                self._put("Node", node)
            case ("gone", str(name)):
                self._take("Node", name)
            case ("namespace", str(name), str(team)):
                self._put("Namespace", worlds.namespace(name, team))

    def _at(self, kind: str, name: str) -> Json | None:
        return next((each for each in self.cluster.objects()[kind] if each["metadata"]["name"] == name), None)

    def _put(self, kind: str, item: Json) -> None:
        items = self.cluster.objects()[kind]
        old = self._at(kind, item["metadata"]["name"])
        if old is None:
            items.append(item)
        else:
            items[items.index(old)] = item
        feed(self.core, kind, item)

    def _take(self, kind: str, name: str) -> None:
        old = self._at(kind, name)
        if old is not None:
            self.cluster.objects()[kind].remove(old)
            feed(self.core, kind, old, remove=True)
