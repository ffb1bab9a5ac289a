"""Volumes on a node: one pod only, zones, limits, and the features a node declares; in upstream's words."""

import pytest
from tests.support.scheduler.volume_worlds import Json, decide, refusals, world
from tests.support.scheduler.volumes import (
    make_attachment,
    make_claim,
    make_class,
    make_csi_node,
    make_driver,
    make_volume,
    mounting,
)
from tests.support.scheduling import make_core, make_info, make_node, make_pod

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore

IN_USE = (
    "node(s) unavailable due to PersistentVolumeClaim with ReadWriteOncePod access mode already in-use by another pod"
)


# --- One pod only, inline disks ---------------------------------------------------------------------------------------------


def test_a_claim_for_one_pod_is_refused_everywhere_until_that_pod_is_gone() -> None:
    core = world(make_volume("v"), make_claim("map", volume="v", modes=("ReadWriteOncePod",)))
    other = mounting("map", name="other", node="n0")
    core.cluster.apply_pod(other.pod)
    refused = decide(core, mounting("map"))
    assert refused.message.startswith(f"0/3 nodes are available: 3 {IN_USE}.")
    assert refused.rejected_by == {"VolumeRestrictions"}
    core.cluster.remove_pod(other.pod)
    assert decide(core, mounting("map")).placed


@pytest.mark.parametrize(
    ("disk", "other", "clash"),
    [
        ({"gcePersistentDisk": {"pdName": "d"}}, {"gcePersistentDisk": {"pdName": "d"}}, True),
        (
            {"gcePersistentDisk": {"pdName": "d", "readOnly": True}},
            {"gcePersistentDisk": {"pdName": "d", "readOnly": True}},
            False,
        ),
        ({"awsElasticBlockStore": {"volumeID": "d"}}, {"awsElasticBlockStore": {"volumeID": "d"}}, True),
        ({"iscsi": {"iqn": "d"}}, {"iscsi": {"iqn": "e"}}, False),
        ({"iscsi": {"iqn": "d"}}, {"iscsi": {"iqn": "d", "readOnly": True}}, True),
        (
            {"rbd": {"monitors": ["a", "b"], "image": "i"}},
            {"rbd": {"monitors": ["b"], "image": "i", "pool": "rbd"}},
            True,
        ),
        ({"rbd": {"monitors": ["a"], "image": "i"}}, {"rbd": {"monitors": ["b"], "image": "i"}}, False),
    ],
)
def test_an_inline_disk_is_mounted_once_per_node(disk: Json, other: Json, clash: bool) -> None:
    core = world()
    core.cluster.apply_pod(make_pod("other", node="n1", volumes=[{"name": "d", **other}]))
    texts = refusals(core, make_info("p", volumes=[{"name": "d", **disk}]))
    assert texts == [(), ("node(s) had no available disk",) if clash else (), ()]


# --- Zones ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("labels", "feasible"),
    [
        ({"topology.kubernetes.io/zone": "z1"}, {"old", "new", "bare"}),
        ({"failure-domain.beta.kubernetes.io/zone": "z1"}, {"old", "new", "bare"}),
        ({"failure-domain.beta.kubernetes.io/zone": "z2__z3"}, {"elsewhere", "bare"}),
        ({"topology.kubernetes.io/zone": "z1__"}, {"old", "new", "elsewhere", "bare"}),
        ({"topology.kubernetes.io/region": "r"}, {"bare"}),
    ],
)
def test_a_volume_in_a_zone_is_reached_by_nodes_of_the_zone_and_by_nodes_without_zones(
    labels: dict[str, str], feasible: set[str]
) -> None:
    core = make_core(
        make_node("new", labels={"topology.kubernetes.io/zone": "z1"}),
        make_node("elsewhere", labels={"topology.kubernetes.io/zone": "z2"}),
        make_node("old", labels={"failure-domain.beta.kubernetes.io/zone": "z1", "topology.kubernetes.io/zone": "z1"}),
        make_node("bare"),
    )
    core.cluster.volumes.apply_volume(make_volume("v", labels=labels))
    core.cluster.volumes.apply_claim(make_claim("map", volume="v"))
    found = refusals(core, mounting("map"))
    names = core.cluster.nodes.names
    assert {name for name, texts in zip(names, found, strict=False) if name and not texts} == feasible
    assert {texts for texts in found if texts} <= {("node(s) had no available volume zone",)}


# --- Limits -------------------------------------------------------------------------------------------------------------------


def limited(limit: int = 2) -> SchedulerCore:
    """Node n0 with room for `limit` volumes of a driver, and claims c0 … c3 bound to volumes of it."""
    claims = [make_claim(f"c{i}", volume=f"v{i}") for i in range(4)]
    volumes = [make_volume(f"v{i}", csi=("csi.example", f"h{i}")) for i in range(4)]
    return world(*claims, *volumes, make_csi_node("n0", {"csi.example": limit}), nodes=1)


def test_a_node_takes_no_more_volumes_than_its_driver_says() -> None:
    core = limited()
    assert decide(core, mounting("c0", "c1")).placed
    assert refusals(core, mounting("c0", "c1", "c2")) == [("node(s) exceed max volume count",)]
    core.cluster.apply_pod(mounting("c0", "c1", name="old", node="n0").pod)
    assert refusals(core, mounting("c2")) == [("node(s) exceed max volume count",)]
    assert refusals(core, mounting("c0")) == [()]


def test_attached_volumes_count_once_beside_those_of_pods() -> None:
    core = limited(3)
    core.cluster.apply_pod(mounting("c0", name="old", node="n0").pod)
    store = core.cluster.volumes
    store.apply_attachment(make_attachment("a0", "n0", "v0", "csi.example"))
    assert refusals(core, mounting("c1", "c2")) == [()]
    store.apply_attachment(make_attachment("a3", "n0", "v3", "csi.example"))
    assert refusals(core, mounting("c1", "c2")) == [("node(s) exceed max volume count",)]
    store.remove_attachment(make_attachment("a3", "n0", "v3", "csi.example"))
    assert refusals(core, mounting("c1", "c2")) == [()]


def test_a_volume_still_to_be_made_counts_for_its_driver_and_once_it_is_made_as_itself() -> None:
    core = limited(1)
    store = core.cluster.volumes
    store.apply_class(make_class(provisioner="csi.example"))
    store.apply_claim(make_claim("new"))
    store.apply_claim(make_claim("more"))
    assert refusals(core, mounting("new")) == [()]
    core.cluster.apply_pod(mounting("new", name="old", node="n0").pod)
    assert refusals(core, mounting("more")) == [("node(s) exceed max volume count",)]
    store.apply_claim(make_claim("new", volume="v0"))
    assert refusals(core, mounting("c0")) == [()]
    assert refusals(core, mounting("c1")) == [("node(s) exceed max volume count",)]


def test_a_driver_that_insists_must_be_on_the_node_and_1_35_does_not_ask() -> None:
    text = "csi.example CSI driver is not installed on the node"
    core = limited()
    core.cluster.volumes.apply_driver(make_driver("csi.example", insists=True))
    assert refusals(core, mounting("c0")) == [()]
    core.cluster.volumes.remove_csi_node(make_csi_node("n0", {}))
    assert refusals(core, mounting("c0")) == [(text,)]
    old = world(
        make_claim("c0", volume="v0"),
        make_volume("v0", csi=("csi.example", "h")),
        make_driver("csi.example", insists=True),
        args={"NodeVolumeLimits": {"compatVersion": "1.35"}},
    )
    assert refusals(old, mounting("c0")) == [(), (), ()]


# --- Features -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spec", "feature"),
    [
        ({"hostNetwork": True, "hostUsers": False}, "UserNamespacesHostNetworkSupport"),
        (
            {"containers": [{"name": "c", "restartPolicyRules": [{"action": "RestartAllContainers"}]}]},
            "RestartAllContainersOnContainerExits",
        ),
        (
            {"initContainers": [{"name": "c", "volumeMounts": [{"name": "v", "bindMountOptions": ["noexec"]}]}]},
            "VolumeBindMountOptions",
        ),
    ],
)
def test_a_pod_goes_where_the_features_it_needs_are_declared(spec: Json, feature: str) -> None:
    core = make_core(make_node("n0"), make_node("n1"))
    able = make_node("n1")
    able.status.declared_features = ("Other", feature)
    text = "node(s) didn't match Pod's required features"
    assert refusals(core, make_info("p", **spec)) == [(text,), (text,)]
    core.cluster.apply_node(able)
    assert refusals(core, make_info("p", **spec)) == [(text,), ()]
    assert refusals(core, make_info("plain", hostNetwork=True)) == [(), ()]


def test_pods_without_volumes_share_their_class_while_claims_come_and_go() -> None:
    core = world(make_class(), make_claim("map"))
    engine = core.runner(SCHEDULER_NAME)
    for index in range(5):
        core.cluster.volumes.apply_claim(make_claim(f"c{index}"))
        decide(core, make_info(f"p{index}"))
    assert len(engine._results) == 1
    assert core.cluster.log.position == world().cluster.log.position
