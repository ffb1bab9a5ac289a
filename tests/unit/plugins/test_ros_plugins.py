from typing import Any

import msgspec
import numpy as np
import pytest
from tests.support.scheduler.volumes import make_volume
from tests.support.scheduling import device_claim, make_cluster, make_core, make_info, make_node, make_pod, telemetry

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.api.ros import (
    DeviceHolder,
    DeviceRequest,
    Endpoint,
    Hardware,
    PeerGroup,
    RosContext,
    SharedVolume,
)
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.framework.interface import Scores, Verdict
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.registry import ROS, catalogue
from robotapp_scheduler.plugins.ros.deadline_score import DeadlineScore
from robotapp_scheduler.plugins.ros.hardware_affinity import HardwareAffinityFilter
from robotapp_scheduler.plugins.ros.latency_filter import LatencyFilter, LatencyFilterArgs
from robotapp_scheduler.plugins.ros.latency_score import LatencyScore, LatencyScoreArgs
from robotapp_scheduler.plugins.ros.load_balance import LoadBalanceArgs, LoadBalanceScore
from robotapp_scheduler.plugins.ros.reserve import ROSReserve
from robotapp_scheduler.plugins.ros.shared_data import SharedDataFilter
from robotapp_scheduler.plugins.ros.topology_score import TopologyScore

ZONE = str(Label.ZONE)
DRAINING = {str(Annotation.GRACEFUL_SHUTDOWN): "true"}


def pod(**context: Any) -> PodInfo:
    info = make_info("p")
    info.ros = RosContext(**context)
    return info


def line(*ms: float) -> Cache:
    """Node `robot` and nodes n0, n1 … that far away from it."""
    cluster = make_cluster(make_node("robot"), *(make_node(f"n{i}") for i in range(len(ms))))
    cluster.apply_telemetry(telemetry("robot", rtt_ms={f"n{i}": value for i, value in enumerate(ms)}))
    return cluster


def near_robot(budget_ms: float | None = None, **fields: Any) -> Endpoint:
    return Endpoint("robot", ("robot",), None if budget_ms is None else int(budget_ms * 1000), **fields)


def mask(answer: Any) -> list[bool]:
    found = answer.mask if isinstance(answer, Verdict) else answer
    assert isinstance(found, np.ndarray)
    return [bool(value) for value in found]


def passing(answer: Any, nodes: Snapshot) -> set[str]:
    return {name for name, passes in zip(nodes.names, mask(answer), strict=True) if passes}


def scores(answer: Any) -> list[float]:
    found = answer.raw if isinstance(answer, Scores) else answer
    assert isinstance(found, np.ndarray)
    return [round(float(value), 3) for value in found]


@pytest.mark.parametrize("name", [ref.name for ref in ROS if ref.name not in {"ROSQueueSort", "ROSBind"}])
def test_a_pod_without_ros_fields_skips_every_ros_plugin(name: str) -> None:
    plugin = catalogue().classes[name]()
    nodes = Snapshot(make_cluster(make_node("n", annotations=DRAINING)))
    plain = make_info("p")
    for hook in ("pre_filter", "filter", "score"):
        if hasattr(plugin, hook):
            assert getattr(plugin, hook)(plain, nodes) is None


# --- LatencyFilter ---------------------------------------------------------------------------------------------------


def latency(**args: Any) -> LatencyFilter:
    return LatencyFilter(msgspec.convert(args, LatencyFilterArgs))


def test_nodes_beyond_the_budget_are_refused_with_their_distance() -> None:
    verdict = latency().filter(pod(endpoints=(near_robot(30),)), Snapshot(line(15, 30, 30.001, 61)))
    assert mask(verdict) == [True, True, True, False, False]
    assert isinstance(verdict, Verdict)
    assert verdict.detail is not None
    assert verdict.detail[3:].tolist() == [30.001, 61.0]
    assert verdict.detail_unit == "ms"
    assert verdict.codes is not None
    assert verdict.reasons[int(verdict.codes[4])] == ("node(s) exceeded the latency budget",)


def test_a_refusal_by_an_estimate_says_so() -> None:
    zones = {"robot": "floor", "near": "hall", "far": "cloud", "other": "cloud"}
    cluster = make_cluster(*(make_node(name, labels={str(Label.ZONE): zone}) for name, zone in zones.items()))
    cluster.apply_telemetry(telemetry("robot", rtt_ms={"near": 5, "far": 60}))
    verdict = latency().filter(pod(endpoints=(near_robot(30),)), Snapshot(cluster))
    assert mask(verdict) == [True, True, False, False]
    assert isinstance(verdict, Verdict)
    assert verdict.codes is not None
    assert [verdict.reasons[int(code)] for code in verdict.codes[2:]] == [
        ("node(s) exceeded the latency budget",),
        ("node(s) exceeded the latency budget by estimate",),
    ]
    assert verdict.detail is not None
    assert verdict.detail[2:].tolist() == [60.0, 60.0]


def out_of_reach() -> Cache:
    """As `line(10)`, with a third node that gets no answer from the robot."""
    cluster = make_cluster(make_node("robot"), make_node("n0"), make_node("cut-off"))
    cluster.apply_telemetry(telemetry("robot", rtt_ms={"n0": 10}, lost=["cut-off"]))
    return cluster


@pytest.mark.parametrize("budget_ms", [None, 30, 3_600_000_000_000])
def test_a_node_that_gets_no_answer_is_beyond_every_budget_whatever_the_configuration_allows(
    budget_ms: float | None,
) -> None:
    info = pod(endpoints=(near_robot(budget_ms),))
    for plugin in (latency(), latency(unknown="Allow", maxLatency="99999h"), latency(outlierFactor=1000)):
        verdict = plugin.filter(info, Snapshot(out_of_reach()))
        assert mask(verdict) == [True, True, False]
        assert isinstance(verdict, Verdict)
        assert verdict.codes is not None
        assert verdict.reasons[int(verdict.codes[2])] == ("node(s) got no answer from the other end of a connection",)
        assert verdict.detail is not None
        assert np.isnan(verdict.detail).all(), "an infinite number is no number to show"


def test_an_end_with_a_second_node_that_is_near_or_not_known_is_not_out_of_reach() -> None:
    cluster = out_of_reach()
    cluster.apply_node(make_node("robot-gpu"))
    info = pod(endpoints=(Endpoint("robot", ("robot", "robot-gpu"), 30_000),))
    assert mask(latency().filter(info, Snapshot(cluster))) == [True] * 4
    cluster.apply_telemetry(telemetry("cut-off", rtt_ms={"robot-gpu": 1}))
    assert mask(latency(unknown="Deny").filter(info, Snapshot(cluster))) == [True] * 4


def test_an_end_out_of_reach_scores_below_every_known_and_unknown_one() -> None:
    cluster = out_of_reach()
    cluster.apply_node(make_node("dark"))
    info = pod(endpoints=(near_robot(40, required=False),), deadline_us=40_000)
    assert scores(LatencyScore().score(info, Snapshot(cluster))) == [100, 75, 0, 50]
    assert scores(DeadlineScore().score(info, Snapshot(cluster))) == [100, 75, 0, 50]
    by_others = LatencyScore(LatencyScoreArgs(normalize="MinMax")).score(info, Snapshot(cluster))
    assert scores(by_others) == [0, -10_000, -80_000, -10_000]


def test_a_connection_without_a_budget_is_held_to_max_latency() -> None:
    info = pod(endpoints=(near_robot(),))
    assert mask(latency().filter(info, Snapshot(line(99, 101)))) == [True, True, False]
    assert mask(latency(maxLatency="1s").filter(info, Snapshot(line(99, 101)))) == [True, True, True]


def test_an_edge_that_is_only_preferred_excludes_nobody() -> None:
    assert all(mask(latency().filter(pod(endpoints=(near_robot(1, required=False),)), Snapshot(line(50)))))


def test_every_connection_must_fit_and_the_nearest_of_several_places_counts() -> None:
    cluster = make_cluster(*(make_node(name) for name in "abc"))
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 10, "c": 40}))
    cluster.apply_telemetry(telemetry("b", rtt_ms={"c": 10}))
    both = (Endpoint("x", ("a",), 20_000), Endpoint("y", ("b",), 5_000))
    assert mask(latency().filter(pod(endpoints=both), Snapshot(cluster))) == [False, True, False]
    either = (Endpoint("x", ("a", "b"), 10_000),)
    assert mask(latency().filter(pod(endpoints=either), Snapshot(cluster))) == [True, True, True]


def test_an_unknown_distance_is_allowed_unless_the_configuration_denies_it() -> None:
    cluster = line(5)
    cluster.apply_node(make_node("dark"))
    info = pod(endpoints=(near_robot(30),))
    assert mask(latency().filter(info, Snapshot(cluster))) == [True, True, True]
    assert mask(latency(unknown="Deny").filter(info, Snapshot(cluster))) == [True, True, False]


def test_a_budget_whose_other_end_is_not_known_fits_nowhere_if_the_configuration_denies_what_is_unknown() -> None:
    info, nodes = pod(unknown_end=True), Snapshot(line(5))
    assert mask(latency().filter(info, nodes)) == [True, True]
    verdict = latency(unknown="Deny").filter(info, nodes)
    assert mask(verdict) == [False, False]
    assert isinstance(verdict, Verdict)
    assert verdict.codes is not None
    assert "the other end of the latency budget: it is not known" in verdict.reasons[int(verdict.codes[0])][0]


def test_draining_nodes_take_no_ros_pods_even_without_connections() -> None:
    cluster = make_cluster(make_node("a", annotations=DRAINING), make_node("b"))
    assert mask(latency().filter(pod(), Snapshot(cluster))) == [False, True]


def test_an_outlier_is_far_from_the_median_and_then_no_row_stands_alone() -> None:
    plugin = latency(outlierFactor=3)
    assert mask(plugin.filter(pod(endpoints=(near_robot(),)), Snapshot(line(5, 6, 7, 50)))) == [True] * 4 + [False]
    assert not plugin.row_local
    assert latency().row_local


@pytest.mark.parametrize(
    ("args", "text"),
    [
        ({"unknown": "Ask"}, "write Allow or Deny"),
        ({"outlierFactor": -1}, "0-1000"),
        ({"maxLatency": "soon"}, "soon"),
    ],
)
def test_arguments_that_cannot_be_honoured_are_refused(args: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        latency(**args)


# --- Hardware, shared data, devices ------------------------------------------------------------------------------------


def hardware_cluster() -> Cache:
    prefix = "hardware.robotics.io/"
    return make_cluster(
        make_node("plain"),
        make_node("gpu", labels={f"{prefix}gpu": "nvidia"}),
        make_node("amd", labels={f"{prefix}gpu": "amd"}),
        make_node("can", labels={f"{prefix}can-can0": "true"}),
        make_node("plugin", **{"nvidia.com/gpu": "1"}),
    )


@pytest.mark.parametrize(
    ("hardware", "expected"),
    [
        (Hardware("gpu"), {"gpu", "amd", "plugin"}),
        (Hardware("gpu", "nvidia"), {"gpu", "plugin"}),
        (Hardware("can", interface="can0"), {"can"}),
        (Hardware("can", interface="can1"), set[str]()),
        (Hardware("lidar"), set[str]()),
    ],
)
def test_requirements_match_labels_or_an_extended_resource(hardware: Hardware, expected: set[str]) -> None:
    nodes = Snapshot(hardware_cluster())
    assert passing(HardwareAffinityFilter().filter(pod(hardware=(hardware,)), nodes), nodes) == expected


def test_every_requirement_must_be_met_and_devices_match_what_agents_see() -> None:
    cluster = hardware_cluster()
    camera = {"id": "usb-cam", "type": "usb", "model": "d435", "identity": "usb:8086:0b3a:77"}
    cluster.apply_telemetry(telemetry("gpu", devices=[camera]))
    wish = DeviceRequest("cam", "usb", usb_id="8086:0b3a")
    nodes = Snapshot(cluster)
    info = pod(hardware=(Hardware("gpu"),), devices=(wish,))
    assert passing(HardwareAffinityFilter().filter(info, nodes), nodes) == {"gpu"}


def test_a_view_of_some_rows_gives_the_same_verdicts_as_the_whole() -> None:
    cluster = hardware_cluster()
    info = pod(hardware=(Hardware("gpu"),), together=(PeerGroup("x", ("gpu", "amd")),))
    for plugin in (HardwareAffinityFilter(), SharedDataFilter(), LatencyFilter()):
        whole = mask(plugin.filter(info, Snapshot(cluster)))
        some = mask(plugin.filter(info, Snapshot(cluster, [4, 1, 0])))
        assert some == [whole[4], whole[1], whole[0]]


def test_a_pod_joins_its_placed_peers_and_keeps_away_from_others() -> None:
    nodes = Snapshot(make_cluster(*(make_node(name) for name in "abc")))
    together = (PeerGroup("map", ("a", "b")), PeerGroup("not placed yet", ()))
    verdict = SharedDataFilter().filter(pod(together=together, apart=("b",)), nodes)
    assert mask(verdict) == [True, False, False]
    assert isinstance(verdict, Verdict)
    assert verdict.codes is not None
    assert [verdict.reasons[int(code)][0] for code in verdict.codes[1:]] == [
        "node(s) ran a component the pod must be separate from",
        "node(s) didn't run a pod that this one must share its node with",
    ]


def test_a_claim_of_shared_data_that_does_not_exist_rejects_the_pod_by_its_name() -> None:
    answer = SharedDataFilter().pre_filter(pod(volumes=(SharedVolume("map", missing=True),)), Snapshot(make_cluster()))
    assert answer is not None
    assert answer.status is not None
    assert answer.status.reason == 'persistentvolumeclaim "map" not found'


def test_a_pod_that_names_a_missing_claim_is_rejected_although_its_like_without_one_was_placed() -> None:
    """Pods that differ in annotations alone have one signature, by which it is kept who narrows the nodes."""
    core = make_core(make_node("n"))
    without = {str(Annotation.POLICIES): '{"qos_class": "realtime"}'}
    assert core.schedule_one(make_info("a", annotations=without)).node == "n"
    named = core.schedule_one(make_info("b", annotations={str(Annotation.SHARED_DATA): '{"pvc": ["gone"]}'}))
    assert not named.node
    assert 'persistentvolumeclaim "gone" not found' in named.message


@pytest.mark.parametrize(
    ("shared", "expected"),
    [
        (SharedVolume("nobody's yet"), "abc"),
        (SharedVolume("local", volume="on-a"), "a"),
        (SharedVolume("network", volume="anywhere"), "abc"),
        (SharedVolume("network", volume="anywhere", users=("b", "c")), "bc"),
        (SharedVolume("not made yet", users=("b",)), "b"),
        (SharedVolume("local", volume="on-a", users=("b",)), ""),
        (SharedVolume("lost", volume="gone"), ""),
    ],
)
def test_a_pod_goes_where_the_volume_of_its_shared_data_can_be_used(shared: SharedVolume, expected: str) -> None:
    cluster = make_cluster(*(make_node(name) for name in "abc"))
    cluster.volumes.apply_volume(make_volume("on-a", on=["a"]))
    cluster.volumes.apply_volume(make_volume("anywhere"))
    nodes = Snapshot(cluster)
    verdict = SharedDataFilter().filter(pod(volumes=(shared,)), nodes)
    assert passing(verdict, nodes) == set(expected)
    assert isinstance(verdict, Verdict)
    assert verdict.codes is not None
    reasons = {verdict.reasons[int(code)] for code in verdict.codes[~verdict.mask]}
    assert reasons <= {("node(s) couldn't use the volume of a claim in the pod's shared data",)}


def test_a_pod_only_fits_where_a_free_device_is_left_for_every_wish() -> None:
    cluster = make_cluster(*(make_node(name) for name in ("one", "two", "busy", "none")))
    bus = [{"id": f"can-can{i}", "type": "can", "interface": f"can{i}"} for i in range(2)]
    for name, devices in (("one", bus[:1]), ("two", bus), ("busy", bus)):
        cluster.apply_telemetry(telemetry(name, devices=devices))
    cluster.apply_claim(device_claim("busy", "can-can0", uid="stranger"))
    holder = DeviceHolder(uid="app", namespace="default", pod_uid="uid-p")
    wishes = (DeviceRequest("left", "can"), DeviceRequest("right", "can"))
    nodes = Snapshot(cluster)
    assert passing(ROSReserve().filter(pod(devices=wishes, holder=holder), nodes), nodes) == {"two"}
    assert passing(ROSReserve().filter(pod(devices=wishes[:1], holder=holder), nodes), nodes) == {"one", "two", "busy"}


# --- Scores ------------------------------------------------------------------------------------------------------------


def test_topology_prefers_master_then_zones_in_order() -> None:
    zones = {"a": "z1", "b": "z2", "c": "z3", "d": "z1"}
    nodes = Snapshot(make_cluster(*(make_node(name, labels={ZONE: zone}) for name, zone in zones.items())))
    assert scores(TopologyScore().score(pod(zones=("z1", "z2"), master_node="d"), nodes)) == [1, 2, 3, 0]
    assert TopologyScore.normalize == "inverse"


def test_topology_is_uniform_for_ros_pods_that_name_none() -> None:
    found = TopologyScore().score(pod(), Snapshot(make_cluster(make_node("a"), make_node("b"))))
    assert isinstance(found, Scores)
    assert (scores(found), found.normalize) == ([80, 80], "none")


def test_latency_scores_the_share_of_the_budget_that_is_left_and_one_slow_node_flattens_nothing() -> None:
    found = LatencyScore().score(pod(endpoints=(near_robot(40),)), Snapshot(line(10, 20, 4000)))
    assert scores(found) == [100.0, 75.0, 50.0, 0.0]


def test_latency_is_neutral_without_a_budget_and_where_nothing_is_known() -> None:
    cluster = line(10)
    cluster.apply_node(make_node("dark"))
    assert scores(LatencyScore().score(pod(endpoints=(near_robot(),)), Snapshot(cluster))) == [50, 50, 50]
    assert scores(LatencyScore().score(pod(endpoints=(near_robot(40),)), Snapshot(cluster))) == [100, 75, 50]


def test_the_thesis_form_of_latency_compares_nodes_with_each_other() -> None:
    plugin = LatencyScore(LatencyScoreArgs(normalize="MinMax"))
    found = plugin.score(pod(endpoints=(near_robot(40),)), Snapshot(line(10, 20)))
    assert isinstance(found, Scores)
    assert (scores(found), found.normalize, plugin.row_local) == ([0, -10_000, -20_000], "minmax", False)


def test_deadline_uses_the_95th_percentile_of_the_worst_connection() -> None:
    cluster = make_cluster(make_node("robot"), make_node("near"), make_node("jumpy"))
    reading = telemetry("robot", rtt_ms={"near": 10, "jumpy": 10}, p95_ms={"near": 10, "jumpy": 60})
    cluster.apply_telemetry(reading)
    end = near_robot(percentile=50)
    found = DeadlineScore().score(pod(endpoints=(end,), deadline_us=50_000), Snapshot(cluster))
    assert scores(found) == [100.0, 80.0, 0.0]
    assert DeadlineScore().score(pod(endpoints=(end,)), Snapshot(cluster)) is None
    assert DeadlineScore().score(pod(deadline_us=50_000), Snapshot(cluster)) is None


@pytest.mark.parametrize(
    ("qos_class", "cpu", "memory", "gpu"),
    [("realtime", 0.65, 0.25, 0.10), ("best_effort", 0.35, 0.35, 0.30), ("sensor_data", 0.50, 0.30, 0.20)],
)
def test_load_is_weighted_by_class_and_a_missing_gpu_leaves_its_weight_to_the_others(
    qos_class: str, cpu: float, memory: float, gpu: float
) -> None:
    with_gpu = make_node("gpu", cpu="4", memory="8Gi", **{"nvidia.com/gpu": "1"})
    cluster = make_cluster(make_node("plain", cpu="4", memory="8Gi"), with_gpu)
    cluster.apply_pod(make_pod("a", node="plain", cpu="2", memory="2Gi"))
    requests = {"cpu": "2", "memory": "2Gi", "nvidia.com/gpu": "1"}
    cluster.apply_pod(make_pod("b", node="gpu", containers=[{"name": "c", "resources": {"requests": requests}}]))
    used = cpu * 0.5 + memory * 0.25
    expected = [100 * (1 - used / (cpu + memory)), 100 * (1 - used - gpu)]
    assert scores(LoadBalanceScore().score(pod(qos_class=qos_class), Snapshot(cluster))) == [
        round(e, 3) for e in expected
    ]


def test_an_empty_node_scores_100_and_a_node_without_anything_too() -> None:
    nodes = Snapshot(make_cluster(make_node("empty"), make_node("nothing", cpu="0", memory="0")))
    assert scores(LoadBalanceScore().score(pod(), nodes)) == [100.0, 100.0]


def test_measured_load_replaces_requests_where_an_agent_reports_it() -> None:
    cluster = make_cluster(make_node("a", cpu="4"), make_node("b", cpu="4"))
    cluster.apply_telemetry(telemetry("a", load={"cpuPercent": 80, "memoryPercent": 40}))
    plugin = LoadBalanceScore(LoadBalanceArgs(source="Telemetry"))
    assert scores(plugin.score(pod(), Snapshot(cluster))) == [35.0, 100.0]
