"""Disks of the old in-tree kinds: the driver that took them over, its handle, and where it says they are."""

import json

import msgspec
import pytest
from tests.support.scheduler.volume_worlds import Json, world
from tests.support.scheduler.volumes import make_csi_node

from robotapp_scheduler.core.api.core_v1 import OLD_REGION, OLD_ZONE, REGION, ZONE
from robotapp_scheduler.core.api.csi_migration import handle_of, kind_of
from robotapp_scheduler.core.api.storage_v1 import CSINode, PersistentVolume

EBS = "topology.ebs.csi.aws.com/zone"
AWS = {"awsElasticBlockStore": {"volumeID": "vol-1"}}


def volume(source: Json, labels: dict[str, str] | None = None, *terms: dict[str, list[str]]) -> PersistentVolume:
    """`terms`: values by label, which must be among them."""
    expressions = [[{"key": key, "operator": "In", "values": values} for key, values in term.items()] for term in terms]
    required = {"nodeSelectorTerms": [{"matchExpressions": each} for each in expressions]}
    affinity = {"nodeAffinity": {"required": required}} if terms else {}
    meta = {"name": "v", "labels": labels or {}}
    return msgspec.convert({"metadata": meta, "spec": source | affinity}, PersistentVolume)


def wanted(found: PersistentVolume) -> list[dict[str, tuple[str, ...]]]:
    affinity = found.translated_affinity
    terms = affinity.node_selector_terms if affinity is not None else ()
    return [{each.key: each.values for each in term.match_expressions} for term in terms]


@pytest.mark.parametrize(
    ("source", "labels", "driver", "handle"),
    [
        (AWS, {}, "ebs.csi.aws.com", "vol-1"),
        ({"awsElasticBlockStore": {"volumeID": "aws://eu-1a/vol-2"}}, {}, "ebs.csi.aws.com", "vol-2"),
        ({"awsElasticBlockStore": {"volumeID": "aws:///vol-2"}}, {}, "ebs.csi.aws.com", "vol-2"),
        ({"gcePersistentDisk": {"pdName": "d"}}, {}, "pd.csi.storage.gke.io", "projects/UNSPECIFIED/zones/UNSPECIFIED/disks/d"),
        ({"gcePersistentDisk": {"pdName": "d"}}, {ZONE: "us-a1-b"}, "pd.csi.storage.gke.io", "projects/UNSPECIFIED/zones/us-a1-b/disks/d"),
        ({"gcePersistentDisk": {"pdName": "d"}}, {OLD_ZONE: "us-a1-b__us-a1-c", ZONE: "x"}, "pd.csi.storage.gke.io",
         "projects/UNSPECIFIED/regions/us-a1/disks/d"),
        ({"azureDisk": {"diskURI": "/subscriptions/x", "kind": "managed"}}, {}, "disk.csi.azure.com", "/subscriptions/x"),
        ({"cinder": {"volumeID": "c"}}, {}, "cinder.csi.openstack.org", "c"),
        ({"portworxVolume": {"volumeID": "p"}}, {}, "pxd.portworx.com", "p"),
    ],
)  # fmt: skip
def test_a_disk_has_the_name_its_driver_gives_it(
    source: Json, labels: dict[str, str], driver: str, handle: str
) -> None:
    spec = volume(source).spec
    kind = kind_of(spec)
    assert kind is not None
    assert (kind.driver, handle_of(spec, labels)) == (driver, handle)


@pytest.mark.parametrize(
    ("source", "labels", "said"),
    [
        ({"awsElasticBlockStore": {"volumeID": "aws://eu-1a/snap-2"}}, {}, "Invalid format for AWS volume"),
        ({"azureDisk": {"diskURI": "http://x/vhds/y", "kind": "Dedicated"}}, {}, "kind(Dedicated) is not supported"),
        ({"gcePersistentDisk": {"pdName": "d"}}, {ZONE: "us-a1-b__eu-a1-b"}, "multiple or no regions"),
        ({"gcePersistentDisk": {"pdName": "d"}}, {ZONE: "a__b"}, "zone in unexpected format"),
    ],
)
def test_a_disk_no_driver_could_know_says_why(source: Json, labels: dict[str, str], said: str) -> None:
    with pytest.raises(ValueError, match=said.replace("(", r"\(").replace(")", r"\)")):
        handle_of(volume(source).spec, labels)


@pytest.mark.parametrize(
    ("labels", "terms", "expected"),
    [
        ({}, (), []),
        ({ZONE: "b__a"}, (), [{EBS: ("a", "b")}]),
        ({OLD_ZONE: "a"}, ({"disk": ["ssd"]},), [{"disk": ("ssd",), EBS: ("a",)}]),
        ({ZONE: "x"}, ({ZONE: ["a"]},), [{EBS: ("a",)}]),
        ({ZONE: "x"}, ({OLD_ZONE: ["a"], OLD_REGION: ["r"]},), [{EBS: ("a",), REGION: ("r",)}]),
        ({}, ({ZONE: ["a"], OLD_REGION: ["r"]}, {"disk": ["ssd"]}), [{EBS: ("a",), OLD_REGION: ("r",)}, {"disk": ("ssd",)}]),
    ],
)  # fmt: skip
def test_zones_are_told_in_the_label_of_the_driver(labels: dict[str, str], terms: tuple[dict[str, list[str]], ...],
                                                   expected: list[dict[str, tuple[str, ...]]]) -> None:  # fmt: skip
    assert wanted(volume(AWS, labels, *terms)) == expected


def test_kinds_without_a_zone_label_of_their_own_keep_their_affinity() -> None:
    found = volume({"azureDisk": {"diskURI": "/d"}}, {ZONE: "x"}, {ZONE: ["a"]})
    assert wanted(found) == [{ZONE: ("a",)}]


def test_a_csi_node_without_drivers_is_read_as_the_api_server_writes_it() -> None:
    found = msgspec.json.decode(json.dumps({"metadata": {"name": "n"}, "spec": {"drivers": None}}), type=CSINode)
    assert found.drivers == ()


def test_a_node_that_no_longer_attaches_a_kind_is_forgotten() -> None:
    volumes = world().cluster.volumes
    node = make_csi_node("n0", {})
    node.metadata.annotations = {
        "storage.alpha.kubernetes.io/migrated-plugins": "kubernetes.io/aws-ebs,kubernetes.io/cinder"
    }
    volumes.apply_csi_node(node)
    assert {plugin: sorted(nodes) for plugin, nodes in volumes.taken_over.items()} == {
        "kubernetes.io/aws-ebs": ["n0"], "kubernetes.io/cinder": ["n0"],
    }  # fmt: skip
    volumes.apply_csi_node(make_csi_node("n0", {}))
    assert not any(volumes.taken_over.values())
