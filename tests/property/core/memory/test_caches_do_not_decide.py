"""Caches only save work, and ROS plugins only speak about ROS pods: compared on random histories of one cluster."""

import json
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.support.scheduling import (
    Clock,
    default_profiles,
    device_claim,
    make_cluster,
    make_info,
    make_node,
    make_pod,
    telemetry,
)
from tests.support.seeds import count_examples

from robotapp_api.model.names import SCHEDULER_NAME, Annotation, Label
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.explain.record import Record, as_json
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner
from robotapp_scheduler.plugins.registry import KUBERNETES, catalogue

Json = dict[str, Any]
NAMES = ("n0", "n1", "n2", "n3", "n4")
HARDWARE = {"hardware.robotics.io/gpu": "nvidia", "hardware.robotics.io/can-can0": "true"}

NODE_STEPS = st.builds(
    lambda name, zone, cpu, hardware, draining, soft: (
        "node",
        make_node(
            name,
            cpu=cpu,
            labels={str(Label.ZONE): zone, str(Label.ROBOT): name if zone == "z1" else "", **hardware},
            annotations={str(Annotation.GRACEFUL_SHUTDOWN): "true"} if draining else {},
            taints=[{"key": "k", "effect": "PreferNoSchedule"}] if soft else [],
        ),
    ),
    st.sampled_from(NAMES),
    st.sampled_from(("z1", "z2")),
    st.sampled_from(("1", "4", "8")),
    st.sampled_from(({}, HARDWARE)),
    st.booleans(),
    st.booleans(),
)
STEPS = st.one_of(
    NODE_STEPS,
    NODE_STEPS,
    st.builds(lambda name: ("gone", name), st.sampled_from(NAMES)),
    st.builds(
        lambda name, node, cpu: ("pod", make_pod(name, node=node, cpu=cpu)),
        st.sampled_from(("x", "y", "z", "mapper")),
        st.sampled_from(NAMES),
        st.sampled_from(("100m", "1", "3")),
    ),
    st.builds(lambda name: ("end", make_pod(name, node="n0")), st.sampled_from(("x", "y", "z", "mapper"))),
    st.builds(
        lambda name, peers, lost, seq, device: (
            "telemetry",
            telemetry(
                name,
                rtt_ms=peers,
                lost=lost,
                seq=seq,
                devices=[{"id": "can-can0", "type": "can", "interface": "can0"}] if device else [],
            ),
        ),
        st.sampled_from(NAMES),
        st.dictionaries(st.sampled_from(NAMES), st.sampled_from((2.0, 20.0, 80.0, 200.0)), max_size=3),
        st.lists(st.sampled_from(NAMES), max_size=1),
        st.sampled_from((None, 1, 2)),
        st.booleans(),
    ),
    st.builds(lambda node: ("claim", device_claim(node, "can-can0", uid="stranger")), st.sampled_from(NAMES)),
    st.builds(lambda node: ("free", device_claim(node, "can-can0", uid="stranger")), st.sampled_from(NAMES)),
    st.builds(lambda seconds: ("time", seconds), st.sampled_from((0.5, 20.0, 40.0))),
)


def ros_pods() -> list[PodInfo]:
    def info(name: str, **annotations: Json) -> PodInfo:
        keys = {"policies": Annotation.POLICIES, "topology": Annotation.TOPOLOGY, "shared": Annotation.SHARED_DATA}
        keys["affinity"] = Annotation.AFFINITY
        texts = {str(keys[key]): json.dumps(value) for key, value in annotations.items()}
        return make_info(name, cpu="500m", annotations=texts)

    return [
        info("near", policies={"latency_budget": "30ms", "deadline": "50ms"}, topology={"master_node": "n1"}),
        info("zones", topology={"preferred_zones": ["z2", "z1"]}, policies={"qos_class": "realtime"}),
        info("beside", shared={"peer_pods": ["mapper"]}, policies={"latency_budget": "90ms"}),
        info("bus", affinity={"hardware_requirements": [{"type": "can", "interface": "can0"}]}),
        make_info("plain", cpu="500m"),
        make_info("tiny", cpu=None, memory=None, tolerations=[{"operator": "Exists"}]),
    ]


def apply(core: SchedulerCore, clock: Clock, step: tuple[str, Any]) -> None:
    kind, value = step
    cluster = core.cluster
    if kind == "time":
        clock.forward(value)
        cluster.tick()
        return
    actions = {
        "node": cluster.apply_node,
        "gone": cluster.remove_node,
        "pod": cluster.apply_pod,
        "end": cluster.remove_pod,
        "telemetry": cluster.apply_telemetry,
        "claim": cluster.apply_claim,
        "free": cluster.remove_claim,
    }
    actions[kind](value)


def compare(core: SchedulerCore, fresh: ProfileRunner, pod: PodInfo) -> None:
    cached = core.runner(SCHEDULER_NAME)
    assert core.prepare(pod) is None
    left, right = cached.evaluate(pod, None), fresh.evaluate(pod, None)
    values = [[evaluation.reasons.values[max(code, 0)] for code in evaluation.reason] for evaluation in (left, right)]
    assert values[0] == values[1]
    assert np.array_equal(left.reason == 0, right.reason == 0)
    assert left.feasible == right.feasible
    if left.feasible > 1:
        cached.score(pod, left)
        fresh.score(pod, right)
        assert left.totals.tolist() == right.totals.tolist()
        positions = np.flatnonzero(left.reason == 0)
        for one, other in zip(left.scores, right.scores, strict=True):
            assert one.skipped == other.skipped
            if not one.skipped:
                assert left.score_of(one, positions) == right.score_of(other, positions)


@settings(
    max_examples=count_examples(120),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(st.lists(NODE_STEPS, min_size=2, max_size=5), st.lists(STEPS, min_size=3, max_size=14))
def test_cached_and_fresh_evaluations_agree_after_any_history(start: list[Any], history: list[Any]) -> None:
    clock = Clock()
    cluster = make_cluster(clock=clock)
    core = SchedulerCore(cluster, default_profiles([ProfileSpec(SCHEDULER_NAME)]), clock=clock)
    fresh = ProfileRunner(core.runner(SCHEDULER_NAME).profile, cluster, caching=False)
    pods = ros_pods()
    for step in [*start, *history]:
        apply(core, clock, step)
        # The zone model is renewed at most once a second: let both see the same one.
        clock.forward(1.5)
        for pod in pods:
            compare(core, fresh, pod)


def told(record: Record) -> Json:
    """A record without what differs between two attempts; reasons are numbered by the engine that met them first."""
    plain = as_json(record)
    plain["refusals"].sort(key=lambda refusal: (refusal["plugin"], refusal["reason"]))
    return {key: value for key, value in plain.items() if key not in {"atS", "attempt"}}


@settings(
    max_examples=count_examples(25),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(st.lists(NODE_STEPS, min_size=2, max_size=5), st.lists(STEPS, max_size=10))
def test_an_explanation_read_later_is_the_one_of_its_moment(start: list[Any], history: list[Any]) -> None:
    clock = Clock()
    cluster = make_cluster(*(make_node(f"m{i}", unschedulable=i == 5) for i in range(14)), clock=clock)
    core = SchedulerCore(cluster, default_profiles([ProfileSpec(SCHEDULER_NAME)]), clock=clock)
    fresh = ProfileRunner(core.runner(SCHEDULER_NAME).profile, cluster, caching=False)
    then: dict[str, Json] = {}
    for moment, step in enumerate([*start, *history]):
        apply(core, clock, step)
        clock.forward(1.5)
        for kind in (*ros_pods(), *ros_pods()[-2:]):
            pod = cluster.pod_info(replace(kind.pod, metadata=replace(kind.pod.metadata, uid=f"{moment}-{len(then)}")))
            then[pod.uid] = told(core.consider(pod, fresh)[0])
            core.schedule_one(pod)
            found = core.explain.get(pod.uid)
            assert found is not None
            assert told(found) == then[pod.uid]
    for uid, expected in then.items():
        found = core.explain.get(uid)
        assert found is not None
        assert told(found) == expected


@settings(
    max_examples=count_examples(100),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(st.lists(NODE_STEPS, min_size=2, max_size=5), st.lists(STEPS, max_size=15))
def test_a_pod_without_ros_fields_decides_the_same_with_all_ros_plugins_and_with_none(
    start: list[Any], history: list[Any]
) -> None:
    clock = Clock()
    cluster = make_cluster(clock=clock)
    only_kubernetes = {
        "multiPoint": PluginSet(enabled=KUBERNETES, disabled=(PluginRef("*"),)),
        "queueSort": PluginSet(enabled=(PluginRef("PrioritySort"),)),
        "bind": PluginSet(enabled=(PluginRef("ROSBind"),)),
    }
    plain = build_profiles([ProfileSpec(SCHEDULER_NAME, plugins=only_kubernetes)], catalogue())
    with_ros = SchedulerCore(cluster, default_profiles([ProfileSpec(SCHEDULER_NAME)]), clock=clock)
    without = SchedulerCore(cluster, plain, clock=clock)
    for step in [*start, *history]:
        apply(with_ros, clock, step)
        for pod in (make_info("plain", cpu="500m"), make_info("tiny", cpu=None, memory=None)):
            left, right = with_ros.schedule_one(pod, assume=False), without.schedule_one(pod, assume=False)
            assert (left.node, left.message, left.total, left.rejected_by) == (
                right.node, right.message, right.total, right.rejected_by,
            )  # fmt: skip
