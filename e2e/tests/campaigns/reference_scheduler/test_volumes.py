"""Volumes by hand: restrictions, limits, binding, room, zones."""

from typing import Any

import pytest

from campaigns.cluster_cases import storage_families as storage
from campaigns.cluster_cases.scene import ZONE, Scene, make_node, make_pod, terminate
from campaigns.reference_scheduler import ClusterDump, Config, Decision, decide

Json = dict[str, Any]
DRIVER = "csi.example.com"
NOTHING = "node(s) didn't find available persistent volumes to bind"


def scene(*names: str) -> Scene:
    """Nodes n0 in z0, n1 in z1, …, and a pod without volumes."""
    made = Scene(nodes=[make_node(name) for name in names or ("n0", "n1")], pod=make_pod("new"))
    for node in made.nodes:
        node["metadata"]["labels"][ZONE] = node["metadata"]["name"].replace("n", "z")
    return made


def run(made: Scene, **config: Any) -> Decision:
    dump = ClusterDump.of([*made.objects, *made.nodes, *made.placed])
    return decide(dump, made.pod, Config(**config))


def only_in(volume: Json, *zones: str) -> None:
    term = {"matchExpressions": [{"key": ZONE, "operator": "In", "values": list(zones)}]}
    volume["spec"]["nodeAffinity"] = {"required": {"nodeSelectorTerms": [term]}}


def texts(decision: Decision) -> dict[str, tuple[str, ...]]:
    return {name: each.texts for name, each in decision.rejections.items()}


def test_an_exclusive_claim_in_use_refuses_every_node_and_may_be_freed() -> None:
    made = scene()
    storage.bound(made, "once", namespace="default", mode="ReadWriteOncePod")
    storage.mount(made.pod, "once")
    assert run(made).feasible == ["n0", "n1"]
    made.placed = [make_pod("o", node="n0")]
    storage.mount(made.placed[0], "once")
    text = (
        "node(s) unavailable due to PersistentVolumeClaim with ReadWriteOncePod access mode "
        "already in-use by another pod"
    )
    assert texts(run(made)) == {"n0": (text,), "n1": (text,)}
    assert not run(made).rejections["n0"].final
    made.placed[0]["spec"]["priority"] = -1
    assert run(made).message.endswith(
        "preemption: found a potential placement for pod on node n0, preempting 1 victims"
    )


@pytest.mark.parametrize(
    ("mine", "theirs", "fits"),
    [
        ({"iscsi": {"iqn": "a"}}, {"iscsi": {"iqn": "a"}}, False),
        ({"iscsi": {"iqn": "a", "readOnly": True}}, {"iscsi": {"iqn": "a"}}, False),
        ({"iscsi": {"iqn": "a", "readOnly": True}}, {"iscsi": {"iqn": "a", "readOnly": True}}, True),
        ({"iscsi": {"iqn": "a"}}, {"iscsi": {"iqn": "b"}}, True),
        ({"rbd": {"monitors": ["m", "n"], "image": "i"}}, {"rbd": {"monitors": ["n"], "image": "i"}}, False),
        ({"rbd": {"monitors": ["m"], "image": "i"}}, {"rbd": {"monitors": ["n"], "image": "i"}}, True),
        ({"gcePersistentDisk": {"pdName": "d"}}, {"gcePersistentDisk": {"pdName": "d"}}, False),
        (
            {"awsElasticBlockStore": {"volumeID": "v", "readOnly": True}},
            {"awsElasticBlockStore": {"volumeID": "v", "readOnly": True}},
            False,
        ),
    ],
)
def test_inline_disks_are_shared_by_readers_only(mine: Json, theirs: Json, *, fits: bool) -> None:
    made = scene("n0")
    made.placed = [make_pod("o", node="n0")]
    made.placed[0]["spec"]["volumes"] = [{"name": "v", **theirs}]
    made.pod["spec"]["volumes"] = [{"name": "v", **mine}]
    assert texts(run(made)) == ({} if fits else {"n0": ("node(s) had no available disk",)})


def limited(count: int) -> Scene:
    """One node that takes `count` volumes; the pod wants one."""
    made = scene("n0")
    driver = {"name": DRIVER, "nodeID": "n0", "allocatable": {"count": count}}
    made.add("CSINode", "n0", spec={"drivers": [driver]})
    storage.bound(made, "a", namespace="default", driver=DRIVER)
    storage.mount(made.pod, "a")
    return made


def using(made: Scene, *claims: str) -> None:
    pod = make_pod(f"o{len(made.placed)}", node="n0")
    for name in claims:
        storage.bound(made, name, namespace="default", driver=DRIVER)
        storage.mount(pod, name)
    made.placed.append(pod)


def test_volumes_count_once_however_many_pods_use_them() -> None:
    made = limited(1)
    using(made, "b")
    assert texts(run(made)) == {"n0": ("node(s) exceed max volume count",)}
    assert not run(made).rejections["n0"].final
    # Another pod here has the volume already: nothing new, full or not.
    using(made, "a")
    assert run(made).feasible == ["n0"]
    made = limited(2)
    using(made, "b")
    using(made, "b")
    assert run(made).feasible == ["n0"]


def test_attachments_count_on_top_of_pods_and_unbound_claims_by_their_class() -> None:
    made = limited(2)
    storage.bound(made, "b", namespace="default", driver=DRIVER)
    spec = {"attacher": DRIVER, "nodeName": "n0", "source": {"persistentVolumeName": "pv-default-b"}}
    made.add("VolumeAttachment", "va", spec=spec)
    assert run(made).feasible == ["n0"]
    storage.storage_class(made, "lazy", waits=True, provisioner=DRIVER)
    storage.claim(made, "lazy", namespace="default", kind="lazy")
    storage.mount(made.pod, "lazy")
    assert texts(run(made)) == {"n0": ("node(s) exceed max volume count",)}


def test_an_attached_volume_that_no_pod_uses_counts_again_for_the_pod_that_wants_it() -> None:
    made = limited(1)
    spec = {"attacher": DRIVER, "nodeName": "n0", "source": {"persistentVolumeName": "pv-default-a"}}
    made.add("VolumeAttachment", "va", spec=spec)
    assert run(made).feasible == []


def test_a_driver_may_insist_on_being_installed_since_1_37() -> None:
    made = scene("n0")
    made.add("CSINode", "n0", spec={"drivers": []})
    made.add("CSIDriver", DRIVER, spec={"preventPodSchedulingIfMissing": True})
    storage.bound(made, "a", namespace="default", driver=DRIVER)
    storage.mount(made.pod, "a")
    assert texts(run(made)) == {"n0": (f"{DRIVER} CSI driver is not installed on the node",)}
    assert run(made, compat_version="1.35").feasible == ["n0"]


def test_a_missing_claim_is_noticed_first_and_loses_the_preemption_tail() -> None:
    made = scene()
    storage.mount(made.pod, "gone")
    assert run(made).message == '0/2 nodes are available: persistentvolumeclaim "gone" not found. not found'


@pytest.mark.parametrize(
    ("trouble", "text"),
    [
        ("unbound", "pod has unbound immediate PersistentVolumeClaims"),
        ("lost", 'persistentvolumeclaim "c" bound to non-existent persistentvolume "pv-default-c"'),
        ("deleting", 'persistentvolumeclaim "c" is being deleted'),
        ("no volume", 'persistentvolume "pv-default-c" not found'),
    ],
)
def test_claims_that_cannot_be_used_refuse_the_pod(trouble: str, text: str) -> None:
    made = scene()
    storage.mount(made.pod, "c")
    if trouble == "unbound":
        storage.claim(made, "c", namespace="default")
    else:
        storage.bound(made, "c", namespace="default")
        claim, volume = made.objects
        if trouble == "lost":
            claim["status"]["phase"] = "Lost"
        elif trouble == "deleting":
            terminate(claim)
        else:
            made.objects.remove(volume)
    assert run(made).message == f"0/2 nodes are available: {text}. not found"


def test_a_bound_volume_has_to_reach_the_node() -> None:
    made = scene()
    only_in(storage.bound(made, "c", namespace="default"), "z1")
    storage.mount(made.pod, "c")
    assert texts(run(made)) == {"n0": ("node(s) didn't match PersistentVolume's node affinity",)}


def waiting(provisioner: str, *sizes: str) -> Scene:
    """Claims of these sizes that wait for the first consumer."""
    made = scene()
    storage.storage_class(made, "lazy", waits=True, provisioner=provisioner)
    for index, size in enumerate(sizes):
        storage.claim(made, f"c{index}", namespace="default", kind="lazy", size=size)
        storage.mount(made.pod, f"c{index}")
    return made


def test_the_smallest_volume_that_fits_is_chosen_and_its_use_is_the_score() -> None:
    made = waiting("kubernetes.io/no-provisioner", "5Gi")
    for name, size, zone in (("pv0", "10Gi", "z0"), ("pv1", "20Gi", "z1"), ("pv2", "40Gi", "z1"), ("pv3", "4Gi", "z1")):
        only_in(storage.volume(made, name, size=size, kind="lazy"), zone)
    # 5 of 10 leaves 50, 5 of 20 leaves 75.
    assert run(made).raw["VolumeBinding"] == {"n0": 50, "n1": 75}
    assert "VolumeBinding" not in run(made, compat_version="1.35").raw


@pytest.mark.parametrize("fault", ["phase", "class", "modes", "selector", "claimed", "deleted", "small"])
def test_volumes_that_do_not_do(fault: str) -> None:
    made = waiting("kubernetes.io/no-provisioner", "5Gi")
    volume = storage.volume(
        made, "pv0", kind="other" if fault == "class" else "lazy", size="4Gi" if fault == "small" else "10Gi"
    )
    claim = made.of_kind("PersistentVolumeClaim")[0]
    if fault == "phase":
        volume["status"]["phase"] = "Released"
    elif fault == "modes":
        claim["spec"]["accessModes"] = ["ReadWriteMany"]
    elif fault == "selector":
        claim["spec"]["selector"] = {"matchLabels": {"speed": "fast"}}
    elif fault == "claimed":
        volume["spec"]["claimRef"] = {"namespace": "default", "name": "c9"}
    elif fault == "deleted":
        terminate(volume)
    assert texts(run(made)) == {"n0": (NOTHING,), "n1": (NOTHING,)}


def test_two_claims_do_not_share_a_volume() -> None:
    made = waiting("kubernetes.io/no-provisioner", "5Gi", "6Gi")
    storage.volume(made, "pv0", kind="lazy", size="10Gi")
    assert run(made).feasible == []
    only_in(storage.volume(made, "pv1", kind="lazy", size="11Gi"), "z0")
    assert run(made).feasible == ["n0"]


def test_a_volume_reserved_for_the_claim_is_the_only_choice() -> None:
    made = waiting("kubernetes.io/no-provisioner", "5Gi")
    storage.volume(made, "pv0", kind="lazy", size="10Gi")
    mine = storage.volume(made, "pv1", kind="lazy", size="20Gi")
    mine["spec"]["claimRef"] = {"namespace": "default", "name": "c0"}
    only_in(mine, "z1")
    assert run(made).feasible == ["n1"]


def test_provisioning_follows_the_topologies_of_the_class() -> None:
    made = waiting(DRIVER, "5Gi")
    topology = {"matchLabelExpressions": [{"key": ZONE, "values": ["z1"]}]}
    made.of_kind("StorageClass")[0]["allowedTopologies"] = [topology]
    assert texts(run(made)) == {"n0": (NOTHING,)}


def test_a_selected_node_is_the_only_one() -> None:
    made = waiting(DRIVER, "5Gi")
    made.of_kind("PersistentVolumeClaim")[0]["metadata"]["annotations"] = {"volume.kubernetes.io/selected-node": "n1"}
    assert texts(run(made)) == {"n0": (NOTHING,)}


def test_room_is_asked_for_where_the_driver_opted_in_and_scores() -> None:
    made = waiting(DRIVER, "5Gi", "5Gi")
    driver = made.add("CSIDriver", DRIVER, spec={"storageCapacity": True})
    for zone, size in (("z0", "20Gi"), ("z1", "4Gi")):
        topology = {"matchLabels": {ZONE: zone}}
        made.add("CSIStorageCapacity", zone, storageClassName="lazy", capacity=size, nodeTopology=topology)
    assert texts(run(made)) == {"n1": ("node(s) did not have enough free storage",)}
    made.of_kind("CSIStorageCapacity")[1]["capacity"] = "100Gi"
    # 10 of 20 leaves 50, 10 of 100 leaves 90.
    assert run(made).raw["VolumeBinding"] == {"n0": 50, "n1": 90}
    made.of_kind("CSIStorageCapacity")[1]["maximumVolumeSize"] = "4Gi"
    assert run(made).feasible == ["n0"]
    driver["spec"]["storageCapacity"] = False
    assert run(made).raw["VolumeBinding"] == {"n0": 0, "n1": 0}


@pytest.mark.parametrize(
    ("labels", "feasible"),
    [
        ({ZONE: "z1"}, ["n1"]),
        ({ZONE: "z0__z1"}, ["n0", "n1"]),
        ({"failure-domain.beta.kubernetes.io/zone": "z0"}, ["n0"]),
        ({"topology.kubernetes.io/region": "r"}, []),
        ({"disk": "ssd"}, ["n0", "n1"]),
    ],
)
def test_zones_of_bound_volumes(labels: dict[str, str], feasible: list[str]) -> None:
    made = scene("n0", "n1", "n2")
    del made.nodes[2]["metadata"]["labels"][ZONE]
    storage.bound(made, "c", namespace="default")["metadata"]["labels"] = labels
    storage.mount(made.pod, "c")
    decision = run(made)
    assert decision.feasible == [*feasible, "n2"]
    assert {text for each in decision.rejections.values() for text in each.texts} <= {
        "node(s) had no available volume zone"
    }
