"""What is kept beside the ledger while things change (amounts in float64, the least that is free, codes of equal amounts) is true."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduling import make_cluster, make_info, make_node, make_pod

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.nodes.resource_arrays import EXACT_IN_FLOAT, MOST_CODES, MOST_MISSES, NO_CODE, MinimumFree
from robotapp_scheduler.plugins.kubernetes.node_resources.balanced_allocation import NodeResourcesBalancedAllocation
from robotapp_scheduler.plugins.kubernetes.node_resources.fit import NodeResourcesFit

NAMES = ("cpu", "memory")
Met = dict[tuple[int, int], list[int]]
"""The amounts that each code of a generation stood for."""
LARGE = ("1", "4", str(EXACT_IN_FLOAT // 1000 - 1), str(EXACT_IN_FLOAT // 500))


@dataclass(frozen=True)
class Step:
    """Something happens to a node or to a pod on it."""

    kind: str
    node: int
    pod: int
    amount: str

    def on(self, cluster: Cache) -> None:
        """Let it happen."""
        name, pod = f"n{self.node}", f"p{self.pod}"
        if self.kind == "node":
            cluster.apply_node(make_node(name, cpu=self.amount, memory="8Gi"))
        elif self.kind == "strange":
            cluster.apply_node(make_node(name, cpu="4", **{f"x.io/{self.pod}": self.amount}))
        elif self.kind == "gone":
            cluster.remove_node(name)
        elif self.kind == "placed":
            cluster.apply_pod(make_pod(pod, node=name, cpu=self.amount, memory="1Gi"))
        else:
            cluster.remove_pod(make_pod(pod, node=name))


STEPS = st.lists(
    st.builds(
        Step,
        kind=st.sampled_from(("node", "strange", "gone", "placed", "placed", "placed", "removed")),
        node=st.integers(0, 4),
        pod=st.integers(0, 9),
        amount=st.sampled_from(LARGE),
    ),
    max_size=12,
)


def agrees(cluster: Cache, met: Met) -> None:
    """Compare what is kept with the ledger, and scores of all rows at once with those of rows named one by one."""
    every, ledger = Snapshot(cluster), cluster.nodes.resources.ledger[:, : cluster.nodes.size]
    valid, plain = every.valid, every.plain(NAMES)
    some = Snapshot(cluster, np.flatnonzero(valid))
    generation, codes = some.amount_codes or (0, np.zeros(some.n, dtype=np.intp))
    for code, amounts in zip(codes.tolist(), ledger[:, valid].T.tolist(), strict=True):
        assert code == NO_CODE or met.setdefault((generation, code), amounts) == amounts
    offered = some.block("allocatable", NAMES)
    if offered.size:
        assert (plain is not None) == (offered.min() > 0 and offered.max() < EXACT_IN_FLOAT)
    if plain is not None:
        for kind, found in plain._asdict().items():
            span = cluster.nodes.resources.span(kind, NAMES)
            assert np.array_equal(found[:, valid], ledger[span][:, valid].astype(np.float64))
    places = ("pods", *NAMES)
    free = some.block("free", places)
    assert np.array_equal(every.block("free", places)[:, valid], free)
    for cpu_milli in (0, 500, 3000, 7999):
        wanted = (("pods", 1), ("cpu", cpu_milli), ("memory", 2**30))
        fits_everywhere = bool((free >= np.array([[amount] for _, amount in wanted])).all())
        assert fits_everywhere or not some.surely_free(wanted) or not free.size
        assert MinimumFree(cluster.nodes).suffices(cluster.log, wanted) == (fits_everywhere and free.size > 0)
    pod: Any = make_info("one-more", cpu="500m", memory="512Mi")
    for plugin in (NodeResourcesFit(), NodeResourcesBalancedAllocation()):
        whole, few = plugin.score(pod, every), plugin.score(pod, some)
        assert isinstance(whole, np.ndarray)
        assert isinstance(few, np.ndarray)
        assert whole.dtype == few.dtype == np.int64
        assert whole[valid].tolist() == few.tolist()


@settings(deadline=None)
@given(st.lists(STEPS, max_size=4), STEPS)
def test_whole_columns_are_those_of_the_ledger_whatever_happens(rounds: list[list[Step]], tried: list[Step]) -> None:
    cluster = make_cluster(*(make_node(f"n{i}", cpu="8", memory="8Gi") for i in range(3)))
    met: Met = {}
    agrees(cluster, met)
    for steps in rounds:
        for step in steps:
            step.on(cluster)
        agrees(cluster, met)
    with DryRun(cluster) as dry_run:
        for step in tried:
            record = cluster.placed.get(make_pod(f"p{step.pod}").metadata.uid)
            if record is not None:
                dry_run.take(record)
                agrees(cluster, met)
    agrees(cluster, met)


def test_what_is_free_again_is_noticed_after_some_pods_that_need_it() -> None:
    cluster = make_cluster(make_node("n", cpu="4"), make_node("m", cpu="4"))
    cluster.apply_pod(make_pod("large", node="n", cpu="4"))
    nodes, wanted = Snapshot(cluster), (("pods", 1), ("cpu", 1000))
    assert not nodes.surely_free(wanted)
    cluster.remove_pod(make_pod("large", node="n"))
    found = []
    for i in range(MOST_MISSES + 1):
        cluster.apply_pod(make_pod(f"p{i}", node="m", cpu="0", memory="0"))
        cluster.remove_pod(make_pod(f"p{i}", node="m"))
        found.append(nodes.surely_free(wanted))
    assert not found[0]
    assert found[-1]


def test_codes_of_amounts_are_given_out_anew_before_there_are_too_many() -> None:
    cluster = make_cluster(make_node("n", cpu="64"), make_node("m", cpu="64"))
    generations: set[int] = set()
    for number in range(2 * MOST_CODES):
        for name in ("n", "m"):
            cluster.apply_pod(make_pod(f"p{number}-{name}", node=name, cpu="1m"))
            coded = Snapshot(cluster, [0, 1]).amount_codes
        if coded is not None:
            generations.add(coded[0])
            assert coded[1].max() < MOST_CODES
    assert len(generations) == 3
