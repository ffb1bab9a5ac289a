"""Which events bring back a pod that a volume plugin refused."""

from typing import Any

import pytest
from tests.support.scheduler.volumes import (
    make_attachment,
    make_capacity,
    make_claim,
    make_class,
    make_csi_node,
    make_driver,
    make_volume,
    mounting,
)
from tests.support.scheduling import make_cluster, make_info, make_node, make_pod

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.plugins.kubernetes.node.declared_features import NodeDeclaredFeatures
from robotapp_scheduler.plugins.kubernetes.volumes.volume_binding import VolumeBinding
from robotapp_scheduler.plugins.kubernetes.volumes.volume_limits import NodeVolumeLimits
from robotapp_scheduler.plugins.kubernetes.volumes.volume_restrictions import VolumeRestrictions
from robotapp_scheduler.plugins.kubernetes.volumes.volume_zone import VolumeZone

POD = mounting("map", ephemeral=["scratch"])
ZONED = {"topology.kubernetes.io/zone": "z1"}
PLUGINS = {
    plugin.name: plugin()
    for plugin in (VolumeBinding, NodeVolumeLimits, VolumeRestrictions, VolumeZone, NodeDeclaredFeatures)
}


def event(change: Change, old: Any = None, new: Any = None, *, resource: str = "things") -> Event:
    return Event(resource, change, old, new)


def removed(pod: Any, change: Change = Change.POD_REMOVED) -> Event:
    return Event("pods", change, pod, None)


TOPOLOGY = [{"matchLabelExpressions": [{"key": "zone", "values": ["a"]}]}]


@pytest.mark.parametrize(
    ("plugin", "happened", "answer"),
    [
        ("VolumeBinding", event(Change.PVC, new=make_claim("map")), True),
        ("VolumeBinding", event(Change.PVC, new=make_claim("p-scratch")), True),
        ("VolumeBinding", event(Change.PVC, new=make_claim("log")), False),
        ("VolumeBinding", event(Change.PVC, new=make_claim("map", namespace="other")), False),
        ("VolumeBinding", event(Change.PV, new=make_volume("v")), True),
        ("VolumeBinding", event(Change.NODE_ADDED, new=make_node("n")), True),
        ("VolumeBinding", event(Change.STORAGE_CLASS, new=make_class()), True),
        ("VolumeBinding", event(Change.STORAGE_CLASS, make_class(), make_class()), False),
        ("VolumeBinding", event(Change.STORAGE_CLASS, make_class(), make_class(topologies=TOPOLOGY)), True),
        ("VolumeBinding", event(Change.CSI_NODE, new=make_csi_node("n", {})), True),
        ("VolumeBinding", event(Change.CSI_NODE, make_csi_node("n", {}), make_csi_node("n", {"d": 5})), False),
        ("VolumeBinding", event(Change.CSI_DRIVER, make_driver("d", capacity=True), make_driver("d")), True),
        ("VolumeBinding", event(Change.CSI_DRIVER, make_driver("d"), make_driver("d", capacity=True)), False),
        ("VolumeBinding", event(Change.CAPACITY, new=make_capacity("c", "1Gi", labels={})), True),
        (
            "VolumeBinding",
            event(Change.CAPACITY, make_capacity("c", "1Gi", labels={}), make_capacity("c", "2Gi", labels={})),
            True,
        ),
        (
            "VolumeBinding",
            event(
                Change.CAPACITY, make_capacity("c", "2Gi", labels={}), make_capacity("c", "9Gi", most="1Gi", labels={})
            ),
            False,
        ),
        ("VolumeBinding", removed(make_pod("x"), Change.POD_REMOVED | Change.PV | Change.PVC), True),
        ("VolumeBinding", event(Change.SELF, make_pod("p"), make_pod("p"), resource="pods"), False),
        ("VolumeRestrictions", removed(mounting("map", name="other").pod), True),
        ("VolumeRestrictions", removed(mounting("map", name="other", namespace="away").pod), False),
        ("VolumeRestrictions", removed(make_pod("other")), False),
        ("VolumeRestrictions", event(Change.PVC, new=make_claim("map")), True),
        ("VolumeRestrictions", event(Change.PVC, new=make_claim("p-scratch")), False),
        ("VolumeRestrictions", event(Change.PVC, make_claim("map"), make_claim("map")), False),
        ("VolumeRestrictions", event(Change.NODE_ADDED, new=make_node("n")), True),
        ("NodeVolumeLimits", removed(mounting("any", name="other").pod), True),
        ("NodeVolumeLimits", removed(make_pod("other")), False),
        ("NodeVolumeLimits", event(Change.CSI_NODE, make_csi_node("n", {"d": 1}), make_csi_node("n", {"d": 2})), True),
        ("NodeVolumeLimits", event(Change.CSI_NODE, make_csi_node("n", {"d": 2}), make_csi_node("n", {"d": 2})), False),
        ("NodeVolumeLimits", event(Change.CSI_NODE, new=make_csi_node("n", {})), True),
        ("NodeVolumeLimits", event(Change.PVC, new=make_claim("p-scratch")), True),
        ("NodeVolumeLimits", event(Change.PVC, make_claim("map"), make_claim("map")), False),
        ("NodeVolumeLimits", event(Change.ATTACHMENT, make_attachment("a", "n", "v", "d")), True),
        ("VolumeZone", event(Change.STORAGE_CLASS, new=make_class()), True),
        ("VolumeZone", event(Change.STORAGE_CLASS, new=make_class(waits=False)), False),
        ("VolumeZone", event(Change.PV, make_volume("v"), make_volume("v", labels=ZONED)), True),
        ("VolumeZone", event(Change.PV, make_volume("v"), make_volume("v", phase="Bound")), False),
        ("VolumeZone", event(Change.PVC, new=make_claim("map", volume="v")), True),
        ("VolumeZone", event(Change.LABELS, make_node("n"), make_node("n", labels=ZONED)), True),
        ("VolumeZone", event(Change.SELF, make_pod("p"), make_pod("p"), resource="pods"), False),
        ("NodeDeclaredFeatures", event(Change.FEATURES, make_node("n"), make_node("n"), resource="nodes"), True),
        ("NodeDeclaredFeatures", event(Change.SELF, make_pod("p"), make_pod("p"), resource="pods"), False),
    ],
)
def test_an_event_brings_a_pod_back_only_when_it_may_help(plugin: str, happened: Event, answer: bool) -> None:
    assert PLUGINS[plugin].hint(POD, happened) is answer


def test_a_pod_with_ephemeral_volumes_only_does_not_wait_for_attachments() -> None:
    gone = event(Change.ATTACHMENT, make_attachment("a", "n", "v", "d"))
    assert not NodeVolumeLimits().hint(mounting(ephemeral=["scratch"]), gone)


def test_pods_that_share_nothing_need_not_be_looked_at_when_one_is_taken_off() -> None:
    cluster = make_cluster(make_node("n0"))
    for other in (mounting("map", name="same", node="n0"), mounting("log", name="log", node="n0")):
        cluster.apply_pod(other.pod)
    cluster.apply_pod(make_pod("plain", node="n0"))
    placed = {record.name: record for record in cluster.placed.values()}
    restrictions, limits = VolumeRestrictions(), NodeVolumeLimits()
    assert [restrictions.touched_by(POD, placed[name]) for name in ("same", "log", "plain")] == [True, False, False]
    assert [limits.touched_by(POD, placed[name]) for name in ("same", "log", "plain")] == [True, True, False]
    assert not restrictions.touched_by(make_info("none"), placed["same"])


def test_inline_disks_wake_those_whose_driver_they_leave_and_a_node_that_takes_over_a_kind_those_with_volumes() -> None:
    disk = make_info("disk", volumes=[{"name": "d", "cinder": {"volumeID": "c"}}])
    limits, driver = PLUGINS["NodeVolumeLimits"], "cinder.csi.openstack.org"
    assert limits.hint(disk, removed(disk.pod))
    assert limits.hint(disk, event(Change.ATTACHMENT, make_attachment("a", "n", "v", driver)))
    assert not limits.hint(disk, event(Change.ATTACHMENT, make_attachment("a", "n", "v", "other.example.com")))
    taking = make_csi_node("n", {})
    taking.metadata.annotations = {"storage.alpha.kubernetes.io/migrated-plugins": "kubernetes.io/cinder"}
    assert PLUGINS["VolumeBinding"].hint(POD, event(Change.CSI_NODE, make_csi_node("n", {}), taking))
