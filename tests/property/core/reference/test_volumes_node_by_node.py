"""Volumes are judged for all nodes at once; each node alone must get the same verdict, score and plan. Caches do not decide."""

from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.scheduler.volumes import (
    make_capacity,
    make_claim,
    make_class,
    make_csi_node,
    make_driver,
    make_volume,
    mounting,
)
from tests.support.scheduling import Clock, default_profiles, make_cluster, make_node
from tests.support.seeds import count_examples

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import ProfileSpec
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner
from robotapp_scheduler.plugins.kubernetes.volumes.volume_binding import VolumeBinding

NODES = ("n0", "n1", "n2", "n3")
CLAIMS = ("c0", "c1", "c2")
SIZES = st.sampled_from(("1Gi", "2Gi", "5Gi", "10Gi"))
ZONES = st.sampled_from(("a", "b"))

NODE_STEPS = st.builds(
    lambda name, zone: ("node", make_node(name, labels={"zone": zone})), st.sampled_from(NODES), ZONES
)
CLAIM_STEPS = st.builds(
    lambda name, size, storage_class, selected, volume: (
        "claim",
        make_claim(name, size=size, storage_class=storage_class, selected=selected, volume=volume),
    ),
    st.sampled_from(CLAIMS),
    SIZES,
    st.sampled_from(("static", "made")),
    st.sampled_from((None, None, None, "n1")),
    st.sampled_from(("", "", "", "v0", "gone")),
)
VOLUME_STEPS = st.builds(
    lambda name, size, on, aside: (
        "volume",
        make_volume(
            name,
            size=size,
            storage_class="static",
            on=on,
            csi=("csi.example", name),
            claim={"namespace": "default", "name": aside} if aside else None,
        ),
    ),
    st.sampled_from(("v0", "v1", "v2", "v3", "v4")),
    SIZES,
    st.lists(st.sampled_from(NODES), max_size=2, unique=True),
    st.sampled_from(("", "", "", "c0")),
)
STEPS = st.one_of(
    NODE_STEPS,
    CLAIM_STEPS,
    VOLUME_STEPS,
    st.builds(lambda name: ("lost", make_volume(name)), st.sampled_from(("v0", "v1", "v2"))),
    st.builds(
        lambda name, room, zone: ("room", make_capacity(name, room, labels={"zone": zone}, storage_class="made")),
        st.sampled_from(("r0", "r1")),
        SIZES,
        ZONES,
    ),
    st.builds(lambda node, limit: ("limit", make_csi_node(node, {"csi.example": limit})), st.sampled_from(NODES),
              st.integers(0, 2)),
    st.builds(lambda name, node: ("pod", mounting(name, name=f"old-{name}", node=node).pod), st.sampled_from(CLAIMS),
              st.sampled_from(NODES)),
)  # fmt: skip


def apply(core: SchedulerCore, step: tuple[str, Any]) -> None:
    kind, value = step
    store = core.cluster.volumes
    actions = {
        "node": core.cluster.apply_node,
        "claim": store.apply_claim,
        "volume": store.apply_volume,
        "lost": store.remove_volume,
        "room": store.apply_capacity,
        "limit": store.apply_csi_node,
        "pod": core.cluster.apply_pod,
    }
    actions[kind](value)


def compare(core: SchedulerCore, fresh: ProfileRunner, pod: PodInfo) -> None:
    engine = core.runner(SCHEDULER_NAME)
    assert core.prepare(pod) is None
    if engine.pre_filter(pod).status is not None:
        return
    whole, anew = engine.evaluate(pod, None), fresh.evaluate(pod, None)
    plugin = VolumeBinding()
    scores: Any = plugin.score(pod, Snapshot(core.cluster))
    for row, name in enumerate(core.cluster.nodes.names):
        alone = fresh.evaluate(pod, frozenset({name}))
        texts = [found.reasons.values[found.reason[at]].texts for found, at in ((whole, row), (anew, row), (alone, 0))]
        assert texts[0] == texts[1] == texts[2]
        if whole.reason[row] == 0:
            one: Any = plugin.score(pod, Snapshot(core.cluster, [row]))
            assert scores[row] == one[0]
            check_plan(core, pod, name, row)


def check_plan(core: SchedulerCore, pod: PodInfo, name: str, row: int) -> None:
    """Every unbound claim has a volume that reaches the node, all different and large enough, or is to be made."""
    plan = VolumeBinding().plan(pod, Snapshot(core.cluster, [row]))
    store = core.cluster.volumes
    assert pod.volumes is not None
    unbound = {("default", use.name) for use in pod.volumes.claims if not store.claims["default", use.name].bound}
    if plan is None:
        assert not unbound
        return
    assert {key for key, _ in plan.bindings} | set(plan.provisions) == unbound
    given = [volume for _, volume in plan.bindings]
    assert len(set(given)) == len(given)
    assert plan.node == name
    for key, volume in plan.bindings:
        assert store.sizes[volume] >= store.claims[key].wants_bytes
        terms = store.volumes[volume].affinity
        assert terms is None or name in terms.node_selector_terms[0].match_expressions[0].values


@settings(
    max_examples=count_examples(60),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(
    st.lists(NODE_STEPS, min_size=1, max_size=4),
    st.lists(STEPS, min_size=2, max_size=14),
    st.lists(st.sampled_from(CLAIMS), min_size=1, max_size=3, unique=True),
)
def test_each_node_alone_gets_the_same_verdict_score_and_plan(
    start: list[Any], history: list[Any], used: list[str]
) -> None:
    clock = Clock()
    core = SchedulerCore(make_cluster(clock=clock), default_profiles([ProfileSpec(SCHEDULER_NAME)]), clock=clock)
    fresh = ProfileRunner(core.runner(SCHEDULER_NAME).profile, core.cluster, caching=False)
    store = core.cluster.volumes
    store.apply_class(make_class("static", provisioner="kubernetes.io/no-provisioner"))
    store.apply_class(make_class("made", provisioner="csi.example"))
    store.apply_driver(make_driver("csi.example", capacity=True))
    for name in used:
        store.apply_claim(make_claim(name, storage_class="static"))
    pod = mounting(*used)
    for step in [*start, *history]:
        apply(core, step)
        compare(core, fresh, pod)
