import json
from typing import Any

import pytest
from tests.support.scheduler.volumes import make_claim
from tests.support.scheduling import app_object, chain, make_cluster, make_info, make_node, make_pod, member_pod

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.api.ros import DeviceHolder, Endpoint, Hardware, RosContext, thesis_tier, tier
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.pods.pod_info import Member, PodInfo
from robotapp_scheduler.core.robotics.app_index import read_app
from robotapp_scheduler.core.robotics.resolve import qos_fields, resolve
from robotapp_scheduler.plugins.ros.shared_data import SharedDataFilter


def fleet() -> Cache:
    return make_cluster(
        make_node("robot", labels={str(Label.ROBOT): "amr"}), make_node("edge"), make_node("cloud"), make_node("other")
    )


def app_cluster(*components: dict[str, Any], **spec: Any) -> Cache:
    cluster = fleet()
    cluster.apply_app(app_object(*components, **spec))
    for component in components:
        for owned in chain(str(component["name"])):
            cluster.apply_owner(owned)
    return cluster


def context(cluster: Cache, component: str, instance: str = "amr") -> RosContext:
    found = resolve(PodInfo(member_pod(component, instance=instance)), cluster)
    assert found is not None
    return found


def annotated(cluster: Cache, labels: dict[str, str] | None = None, **annotations: str) -> RosContext | None:
    keys = {"policies": Annotation.POLICIES, "topology": Annotation.TOPOLOGY, "shared": Annotation.SHARED_DATA}
    keys["affinity"] = Annotation.AFFINITY
    found = {str(keys[name]): text for name, text in annotations.items()}
    return resolve(make_info("p", labels=labels, annotations=found), cluster)


def test_pods_without_ros_fields_have_no_context() -> None:
    assert resolve(make_info("p"), fleet()) is None
    assert annotated(fleet(), topology='{"master_node":"","preferred_zones":[]}') is None


def test_every_pod_of_an_app_and_every_annotated_pod_has_its_namespace_as_tenant() -> None:
    cluster = app_cluster({"name": "driver"})
    infrastructure = resolve(PodInfo(member_pod("", instance="amr-07")), cluster)
    assert infrastructure == RosContext(tenant="default")
    assert context(cluster, "driver").tenant == "default"
    annotated_pod = annotated(cluster, topology='{"preferred_zones":["z"]}')
    assert annotated_pod is not None
    assert annotated_pod.tenant == "default"


def test_a_helper_is_measured_to_every_placed_component_and_excluded_by_none() -> None:
    edge = {"topic": "/t", "from": "a", "to": "b", "latency": {"budget": "30ms"}}
    cluster = app_cluster({"name": "a"}, {"name": "b"}, edges=[edge])
    assert context(cluster, "").endpoints == ()
    cluster.apply_pod(member_pod("b", instance="amr", node="edge"))
    assert context(cluster, "").endpoints == (Endpoint("component b", ("edge",), 30_000, required=False),)
    assert context(app_cluster({"name": "a"}), "").endpoints == ()


def test_an_edge_reaches_its_placed_peer_with_its_own_budget_and_percentile() -> None:
    edge = {"topic": "/t", "from": "a", "to": "b", "latency": {"budget": "30ms", "percentile": 50}}
    cluster = app_cluster({"name": "a"}, {"name": "b"}, edges=[edge])
    assert context(cluster, "a").endpoints == ()
    cluster.apply_pod(member_pod("b", instance="amr", node="edge"))
    assert context(cluster, "a").endpoints == (Endpoint("/t to b", ("edge",), 30_000, 50),)
    assert context(cluster, "a", instance="other-robot").endpoints == ()


def test_peers_count_only_when_their_owner_chain_leads_to_the_app() -> None:
    edge = {"topic": "/t", "from": "a", "to": "b", "latency": {"budget": "30ms"}}
    cluster = app_cluster({"name": "a"}, {"name": "b"}, edges=[edge])
    forged = {str(Label.APP_UID): "app-1", str(Label.COMPONENT): "b", str(Label.INSTANCE): "amr"}
    cluster.apply_pod(make_pod("forged", labels=forged, node="cloud"))
    assert context(cluster, "a").endpoints == ()


def test_the_robot_end_is_the_node_of_the_instance() -> None:
    edge = {"topic": "/t", "from": "a", "to": "@robot", "latency": {"budget": "20ms"}}
    cluster = app_cluster({"name": "a"}, edges=[edge])
    assert context(cluster, "a").endpoints == (Endpoint("/t to @robot", ("robot",), 20_000),)
    assert context(cluster, "a", instance="").endpoints == ()


def computers(*primary: str) -> Cache:
    """A robot of two computers, those named labelled as primary."""
    cluster = app_cluster(
        {"name": "a", "policies": {"latencyBudget": "40ms"}}, {"name": "driver", "runsOn": ["Robot"]},
        edges=[{"topic": "/t", "from": "a", "to": "@robot"}, {"topic": "/u", "from": "a", "to": "driver"}],
    )  # fmt: skip
    for name in ("robot", "robot-2"):
        labels = {str(Label.ROBOT): "amr"} | ({str(Label.ROBOT_PRIMARY): "true"} if name in primary else {})
        cluster.apply_node(make_node(name, labels=labels))
    return cluster


def test_of_a_robot_with_several_computers_the_primary_one_is_the_robot_end() -> None:
    found = {end.what: end.nodes for end in context(computers("robot-2"), "a").endpoints}
    assert found == {"/t to @robot": ("robot-2",), "/u to driver": ("robot", "robot-2")}
    bare = annotated(computers("robot-2"), {str(Label.ROBOT): "amr"}, policies='{"latency_budget":"30ms"}')
    assert bare is not None
    assert bare.endpoints == (Endpoint("robot amr", ("robot-2",), 30_000),)


@pytest.mark.parametrize("primary", [(), ("robot", "robot-2")])
def test_while_none_or_several_computers_are_primary_the_nearest_of_all_counts(primary: tuple[str, ...]) -> None:
    assert context(computers(*primary), "a").endpoints[0].nodes == ("robot", "robot-2")


def test_services_and_actions_are_named_by_their_kind() -> None:
    edges = [{"kind": kind, "topic": "/plan", "from": "a", "to": "b"} for kind in ("Topic", "Service", "Action")]
    cluster = app_cluster({"name": "a"}, {"name": "b"}, edges=edges)
    cluster.apply_pod(member_pod("b", instance="amr", node="edge"))
    assert [end.what for end in context(cluster, "a").endpoints] == [
        "/plan to b", "service /plan to b", "action /plan to b",
    ]  # fmt: skip


def test_the_order_of_tiers_is_kept_where_there_is_one() -> None:
    cluster = app_cluster({"name": "a", "runsOn": ["Edge", "Robot"]}, {"name": "b", "runsOn": ["Robot"]}, {"name": "c"})
    assert [context(cluster, name).tiers for name in "abc"] == [("Edge", "Robot"), (), ()]


def test_a_preferred_edge_and_a_movable_peer_of_a_tied_pod_do_not_exclude_nodes() -> None:
    edges = [
        {"topic": "/soft", "from": "a", "to": "b", "latency": {"budget": "5ms", "enforce": "Preferred"}},
        {"topic": "/hard", "from": "driver", "to": "b", "latency": {"budget": "5ms"}},
        {"topic": "/two", "from": "driver", "to": "base", "latency": {"budget": "5ms"}},
    ]
    tied = {"runsOn": ["Robot"]}
    cluster = app_cluster(
        {"name": "a"}, {"name": "b"}, {"name": "driver", **tied}, {"name": "base", **tied}, edges=edges
    )
    for name in ("b", "base"):
        cluster.apply_pod(member_pod(name, instance="amr", node="cloud"))
    assert [end.required for end in context(cluster, "a").endpoints] == [False]
    assert {end.what: end.required for end in context(cluster, "driver").endpoints} == {
        "/hard to b": False, "/two to base": True,
    }  # fmt: skip


def test_a_components_own_budget_covers_edges_without_one_else_the_robot() -> None:
    policies = {"latencyBudget": "40ms", "deadline": "50ms"}
    cluster = app_cluster(
        {"name": "a", "policies": policies}, {"name": "b"}, {"name": "lonely", "policies": policies},
        edges=[{"topic": "/t", "from": "a", "to": "b"}],
    )  # fmt: skip
    cluster.apply_pod(member_pod("b", instance="amr", node="edge"))
    assert context(cluster, "a").endpoints == (Endpoint("/t to b", ("edge",), 40_000),)
    assert context(cluster, "a").deadline_us == 50_000
    assert context(cluster, "lonely").endpoints == (Endpoint("robot amr", ("robot",), 40_000),)


def test_devices_are_held_for_app_instance_and_component_and_gpus_never() -> None:
    devices = [{"name": "cam", "type": "usb", "usbID": "8086:0b3a"}, {"name": "gpu", "type": "gpu", "model": "nvidia"}]
    cluster = app_cluster({"name": "a", "devices": devices, "requires": [{"type": "lidar", "interface": "front"}]})
    found = context(cluster, "a")
    assert [(request.name, request.usb_id) for request in found.devices] == [("cam", "8086:0b3a")]
    assert found.hardware == (Hardware("lidar", interface="front"), Hardware("gpu", "nvidia"))
    assert found.holder == DeviceHolder("app-1", "default", "amr", "a", "uid-teleop-a")


def test_only_exclusive_devices_are_held_and_a_count_asks_for_as_many() -> None:
    devices = [
        {"name": "bus", "type": "can", "count": 2},
        {"name": "tap", "type": "can", "sharing": "Namespace"},
        {"name": "mic", "type": "usb", "sharing": "Cache"},
    ]
    found = context(app_cluster({"name": "a", "devices": devices}), "a")
    assert [(request.name, request.exclusive) for request in found.devices] == [
        ("bus", True), ("bus", True), ("tap", False), ("mic", False),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("shared", "labels", "unknown"),
    [
        ("{}", {}, True),
        ('{"peer_pods": ["legacy"]}', {}, False),
        ('{"peer_pods": ["not placed yet"]}', {}, True),
        ("{}", {str(Label.ROBOT): "amr"}, False),
        ("{}", {str(Label.ROBOT): "not there"}, True),
    ],
)
def test_of_a_bare_pods_budget_is_known_whether_it_has_another_end(
    shared: str, labels: dict[str, str], *, unknown: bool
) -> None:
    cluster = fleet()
    cluster.apply_pod(make_pod("legacy", node="other"))
    for budget in ("30ms", ""):
        policies = json.dumps({"latency_budget": budget} if budget else {"qos_class": "realtime"})
        found = annotated(cluster, labels, policies=policies, shared=shared)
        assert found is not None
        assert found.unknown_end == (unknown and bool(budget))


def test_of_an_apps_budgets_only_one_to_a_robot_that_is_not_there_has_no_known_end() -> None:
    budget = {"latency": {"budget": "30ms"}}
    edges = [{"topic": "/t", "from": "a", "to": "b", **budget}, {"topic": "/r", "from": "@robot", "to": "c", **budget}]
    own = {"policies": {"latencyBudget": "30ms"}}
    cluster = app_cluster(
        {"name": "a", **own}, {"name": "b"}, {"name": "c"}, {"name": "d", **own}, {"name": "e"}, edges=edges
    )
    for instance, lacking in (("amr", ""), ("", "cd")):
        found = [name for name in "abcde" if context(cluster, name, instance).unknown_end]
        assert "".join(found) == lacking


def test_claims_of_shared_data_are_looked_up_and_those_of_many_nodes_limit_nothing() -> None:
    names = ["map", "site", "gone"]
    cluster = app_cluster({"name": "a", "sharedData": {"claimNames": names}})
    cluster.volumes.apply_claim(make_claim("map", volume="disk"))
    cluster.volumes.apply_claim(make_claim("site", volume="nfs", modes=["ReadWriteMany"]))
    cluster.volumes.apply_claim(make_claim("gone", namespace="other"))
    cluster.apply_pod(make_pod("reader", node="edge", volumes=[{"persistentVolumeClaim": {"claimName": "map"}}]))
    found = context(cluster, "a").volumes
    assert [(each.claim, each.volume, each.users, each.missing) for each in found] == [
        ("map", "disk", ("edge",), False),
        ("gone", "", (), True),
    ]
    text = json.dumps({"pvc": names})
    assert getattr(annotated(cluster, shared=text), "volumes", None) == found


def test_a_pod_that_is_ending_keeps_nobody_at_the_node_of_its_volume() -> None:
    """On a node that is lost it ends for ever, and its successor may go elsewhere."""
    cluster = app_cluster({"name": "a", "sharedData": {"claimNames": ["map"]}})
    cluster.volumes.apply_claim(make_claim("map"))
    mounts = {"volumes": [{"persistentVolumeClaim": {"claimName": "map"}}]}
    reader = make_pod("reader", node="edge", **mounts)
    cluster.apply_pod(reader)
    cluster.apply_pod(make_pod("writer", node="cloud", **mounts))
    cluster.apply_pod(make_pod("stranger", node="edge", namespace="other", **mounts))
    assert [each.users for each in context(cluster, "a").volumes] == [("cloud", "edge")]
    ending = make_pod("reader", node="edge", **mounts)
    ending.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    assert cluster.apply_pod(ending) & SharedDataFilter.events, "who waits for it is tried again"
    assert [each.users for each in context(cluster, "a").volumes] == [("cloud",)]


def test_peers_to_join_and_to_avoid_are_resolved_to_nodes() -> None:
    cluster = app_cluster(
        {"name": "a", "colocateWith": ["b"], "separateFrom": ["c"], "sharedData": {"with": ["d"], "peerPods": ["legacy"]}},
        {"name": "b"}, {"name": "c"}, {"name": "d"},
    )  # fmt: skip
    cluster.apply_pod(member_pod("b", instance="amr", node="edge"))
    cluster.apply_pod(member_pod("c", instance="amr", node="cloud"))
    cluster.apply_pod(make_pod("legacy", node="other"))
    found = context(cluster, "a")
    assert {group.what: group.nodes for group in found.together} == {
        "component b": ("edge",), "component d": (), "legacy": ("other",),
    }  # fmt: skip
    assert found.apart == ("cloud",)


def beside(cluster: Cache, component: str) -> dict[str, tuple[str, ...]]:
    return {group.what.removeprefix("component "): group.nodes for group in context(cluster, component).together}


def test_who_is_named_in_colocate_with_is_bound_to_its_node_too() -> None:
    """The attack: cordon the node, delete the pod that declares nothing; it must not start elsewhere."""
    for field in ({"colocateWith": ["driver"]}, {"sharedData": {"with": ["driver"]}}):
        cluster = app_cluster({"name": "camera", **field}, {"name": "driver"})
        cluster.apply_pod(member_pod("camera", instance="amr", node="robot"))
        assert beside(cluster, "driver") == {"camera": ("robot",)}


def test_sharing_a_node_reaches_over_a_component_that_is_not_placed_yet() -> None:
    cluster = app_cluster(
        {"name": "a", "colocateWith": ["b"]}, {"name": "b"}, {"name": "c", "colocateWith": ["b"]},
        {"name": "d", "separateFrom": ["b"]},
    )  # fmt: skip
    cluster.apply_pod(member_pod("a", instance="amr", node="edge"))
    assert beside(cluster, "c") == {"a": ("edge",), "b": ()}
    assert context(cluster, "d").apart == ("edge",), "b has to go there"
    cluster.apps.expect({Member("app-1", "amr", "b"): ("edge", "cloud")})
    assert beside(cluster, "c") == {"a": ("edge",), "b": ("cloud", "edge")}


def test_all_replicas_go_where_a_partner_of_one_replica_is() -> None:
    cluster = app_cluster({"name": "one", "colocateWith": ["two"]}, {"name": "two", "replicas": 2})
    cluster.apply_pod(member_pod("two", instance="amr", uid="first", node="edge"))
    assert beside(cluster, "two") == {"one": (), "two": ("edge",)}
    assert beside(cluster, "one") == {"two": ("edge",)}


def test_components_keep_apart_whichever_of_the_two_asks_for_it_and_whichever_comes_first() -> None:
    cluster = app_cluster(
        {"name": "console", "separateFrom": ["driver", "arm"]}, {"name": "driver", "runsOn": ["Robot"]}, {"name": "arm"},
    )  # fmt: skip
    assert context(cluster, "console").apart == ("robot",), "the driver will be there"
    cluster.apps.expect({Member("app-1", "amr", "arm"): ("edge",)})
    assert context(cluster, "console").apart == ("edge", "robot"), "the arm has no other place"
    cluster.apps.expect({Member("app-1", "amr", "arm"): ("edge", "cloud")})
    assert context(cluster, "console").apart == ("robot",), "the arm can go elsewhere"
    cluster.apply_pod(member_pod("console", instance="amr", node="cloud"))
    assert context(cluster, "driver").apart == ("cloud",)
    assert context(cluster, "arm").apart == ("cloud",)


def test_placement_gives_zones_and_master() -> None:
    cluster = app_cluster({"name": "a"}, placement={"zones": ["z1"], "masterNode": "edge"})
    assert (context(cluster, "a").zones, context(cluster, "a").master_node) == (("z1",), "edge")


def test_a_bare_pods_budget_reaches_master_then_placed_peers_then_its_robot() -> None:
    cluster = fleet()
    policies = '{"latency_budget":"30ms"}'
    robot = {str(Label.ROBOT): "amr"}
    found = annotated(cluster, robot, policies=policies)
    assert found is not None
    assert found.endpoints == (Endpoint("robot amr", ("robot",), 30_000),)
    found = annotated(cluster, robot, policies=policies, shared='{"peer_pods":["mapper"]}')
    assert found is not None
    assert found.endpoints[0].what == "robot amr"
    cluster.apply_pod(make_pod("mapper", node="cloud"))
    found = annotated(cluster, robot, policies=policies, shared='{"peer_pods":["mapper"]}')
    assert found is not None
    assert found.endpoints == (Endpoint("peer mapper", ("cloud",), 30_000),)
    found = annotated(cluster, robot, policies=policies, topology='{"master_node":"edge"}')
    assert found is not None
    assert found.endpoints == (Endpoint("master node edge", ("edge",), 30_000),)
    found = annotated(cluster, policies=policies)
    assert found is not None
    assert found.endpoints == ()


def test_peers_of_another_namespace_are_strangers() -> None:
    cluster = fleet()
    cluster.apply_pod(make_pod("mapper", node="cloud", namespace="other"))
    found = annotated(cluster, shared='{"peer_pods":["mapper"]}')
    assert found is not None
    assert found.together[0].nodes == ()


def test_exclusive_types_of_a_bare_pod_become_devices_it_holds_alone() -> None:
    found = annotated(fleet(), affinity='{"hardware_requirements":[{"type":"gpu"},{"type":"can","interface":"can0"}]}')
    assert found is not None
    assert [(request.type, request.interface) for request in found.devices] == [("can", "can0")]
    assert [hardware.type for hardware in found.hardware] == ["gpu", "can"]
    assert found.holder == DeviceHolder(uid="uid-p", namespace="default", pod_uid="uid-p")


def test_annotations_of_an_apps_pod_do_not_count() -> None:
    cluster = app_cluster({"name": "a"})
    pod = member_pod("a", annotations={str(Annotation.TOPOLOGY): '{"master_node":"edge"}'})
    found = resolve(PodInfo(pod), cluster)
    assert found is not None
    assert found.master_node == ""


def test_durations_nobody_can_read_are_collected_with_their_path() -> None:
    edge = {"topic": "/t", "from": "a", "to": "b", "latency": {"budget": "fast"}}
    app = read_app(app_object({"name": "a", "policies": {"deadline": "5"}}, edges=[edge]))
    assert app.problems == (
        "spec.edges[0].latency.budget: 'fast' is not a duration such as 30ms",
        "spec.components[0].policies.deadline: '5' is not a duration such as 30ms",
    )


def test_the_tier_comes_from_the_class_and_rises_for_reliable_manual_liveliness() -> None:
    assert [tier(c, reliability="best_effort", liveliness="") for c in ("realtime", "sensor_data", "best_effort")] == [
        3,
        2,
        0,
    ]
    assert tier("best_effort", reliability="reliable", liveliness="manual_by_topic") == 2
    assert tier("realtime", reliability="reliable", liveliness="manual_by_topic") == 3
    assert thesis_tier("realtime", reliability="best_effort", liveliness="") == 0
    assert thesis_tier("realtime", reliability="reliable", liveliness="manual_by_topic") == 2


def test_the_queue_reads_the_class_from_the_app_or_the_annotations() -> None:
    cluster = app_cluster({"name": "a", "qosClass": "realtime"})
    assert qos_fields(PodInfo(member_pod("a")), cluster.apps) == ("realtime", "", "")
    info = make_info("p", annotations={str(Annotation.POLICIES): '{"qos_class":"sensor_data"}'})
    assert qos_fields(info, cluster.apps) == ("sensor_data", "", "")
    assert qos_fields(make_info("plain"), cluster.apps) is None


@pytest.mark.parametrize(
    ("annotations", "labels", "without"),
    [
        ({"policies": '{"latency_budget": "30ms"}'}, {}, True),
        ({"policies": '{"latency_budget": "30ms"}', "topology": '{"master_node": "edge"}'}, {}, False),
        ({"policies": '{"latency_budget": "30ms"}', "shared-data": '{"peer_pods": ["other"]}'}, {}, False),
        ({"policies": '{"latency_budget": "30ms"}'}, {Label.ROBOT: "amr"}, False),
        ({"policies": '{"qos_class": "realtime"}'}, {}, False),
        ({"policies": '{"latency_budget": "30"}'}, {}, False),
        ({}, {}, False),
    ],
)
def test_a_budget_whose_other_end_nobody_states_is_noticed(
    annotations: dict[str, str], labels: dict[str, str], *, without: bool
) -> None:
    keys = {f"scheduler.robotics.io/{name}": text for name, text in annotations.items()}
    assert make_info("p", annotations=keys, labels=labels).budget_without_end is without
