"""Rules that the live comparison with kube-scheduler 1.37 does not reach: older releases, and features behind a gate."""

from typing import Any

from campaigns.cluster_cases import storage_families as storage
from campaigns.cluster_cases.scene import ZONE, Scene, make_node, make_pod
from campaigns.reference_scheduler import ClusterDump, Config, Decision, decide
from campaigns.reference_scheduler.nodes.resources import held

Json = dict[str, Any]
BALANCE = "NodeResourcesBalancedAllocation"
DRIVER = "csi.example.com"


def run(pod: Json, *nodes: Json, **config: Any) -> Decision:
    return decide(ClusterDump(nodes=list(nodes)), pod, Config(**config))


def run_scene(scene: Scene, **config: Any) -> Decision:
    return decide(ClusterDump.of([*scene.objects, *scene.nodes]), scene.pod, Config(**config))


def resized(*containers: tuple[str, str, str], reason: str = "") -> Json:
    """Builds a pod of containers with requested, allocated and actual CPU."""
    pod = make_pod("p")
    named = [(f"c{index}", *amounts) for index, amounts in enumerate(containers)]
    pod["spec"]["containers"] = [{"name": name, "resources": {"requests": {"cpu": spec}}} for name, spec, _, _ in named]
    pod["status"]["containerStatuses"] = [
        {"name": name, "allocatedResources": {"cpu": allocated}, "resources": {"requests": {"cpu": actual}}}
        for name, _, allocated, actual in named
    ]
    if reason:
        pod["status"]["conditions"] = [{"type": "PodResizePending", "status": "True", "reason": reason}]
    return pod


def test_totals_are_compared_since_1_36_and_containers_before() -> None:
    pod = resized(("100m", "100m", "300m"), ("300m", "300m", "100m"))
    assert held(pod, "cpu") == 400
    assert held(pod, "cpu", compat_version="1.35") == 600


def test_an_infeasible_resize_leaves_the_wish_out() -> None:
    pod = resized(("9", "500m", "300m"), reason="Infeasible")
    assert held(pod, "cpu") == 500
    assert held(pod, "cpu", compat_version="1.35") == 500
    assert held(resized(("9", "500m", "300m"), reason="Deferred"), "cpu") == 9000


def test_balance_scores_the_change_since_1_36_and_the_state_before() -> None:
    pod = make_pod("p", cpu="2", memory="2Gi")
    # With the pod 0.5 and 0.25: std 0.125, 87; empty 100: 50 + (50 + 87 - 100) // 2 = 68. b: 0.25 and 0.25: 100 and 75.
    nodes = (make_node("a"), make_node("b", cpu="8"))
    assert run(pod, *nodes).raw[BALANCE] == {"a": 68, "b": 75}
    assert run(pod, *nodes, compat_version="1.35").raw[BALANCE] == {"a": 87, "b": 100}


def test_balance_of_three_resources_uses_the_standard_deviation() -> None:
    pod = make_pod("p", cpu="2", memory="2Gi")
    three = ("cpu", "memory", "ephemeral-storage")
    decision = run(pod, make_node("a"), make_node("b"), compat_version="1.35", balanced_resources=three)
    # 0.5, 0.25, 0: mean 0.25, std 0.2041.
    assert decision.raw[BALANCE]["a"] == 79


def test_image_volumes_count_in_the_sum_and_in_the_number_of_images_but_not_in_1_35() -> None:
    pod = make_pod("p")
    pod["spec"]["containers"] = [{"name": "c", "image": "other:1"}]
    pod["spec"]["volumes"] = [{"name": "v", "image": {"reference": "map:1"}}]
    nodes = (make_node("a"), make_node("b"))
    nodes[0]["status"]["images"] = [{"names": ["map:1"], "sizeBytes": 1000 * 1024 * 1024}]
    # 500 MiB of two images: 100 * (500 - 23) // (2000 - 23) = 24.
    assert run(pod, *nodes).raw["ImageLocality"]["a"] == 24
    assert run(pod, *nodes, compat_version="1.35").raw["ImageLocality"]["a"] == 0


def test_declared_features_are_needed_where_the_pod_says_so() -> None:
    plain, able = make_node("a"), make_node("b")
    able["status"]["declaredFeatures"] = ["UserNamespacesHostNetworkSupport"]
    pod = make_pod("p")
    pod["spec"] |= {"hostNetwork": True, "hostUsers": False}
    decision = run(pod, plain, able)
    assert decision.feasible == ["b"]
    assert decision.rejections["a"].texts == ("node(s) didn't match Pod's required features",)
    del pod["spec"]["hostUsers"]
    assert run(pod, plain, able).feasible == ["a", "b"]


def test_a_driver_may_insist_on_being_installed_since_1_37() -> None:
    scene = Scene(nodes=[make_node("n0")], pod=make_pod("new"))
    scene.add("CSINode", "n0", spec={"drivers": []})
    scene.add("CSIDriver", DRIVER, spec={"preventPodSchedulingIfMissing": True})
    storage.bound(scene, "a", namespace="default", driver=DRIVER)
    storage.mount(scene.pod, "a")
    assert run_scene(scene).rejections["n0"].texts == (f"{DRIVER} CSI driver is not installed on the node",)
    assert run_scene(scene, compat_version="1.35").feasible == ["n0"]


def test_the_smallest_volume_that_fits_is_chosen_and_its_use_is_the_score() -> None:
    scene = Scene(nodes=[make_node("n0"), make_node("n1")], pod=make_pod("new"))
    for node, zone in zip(scene.nodes, ("z0", "z1"), strict=True):
        node["metadata"]["labels"][ZONE] = zone
    storage.storage_class(scene, "lazy", waits=True, provisioner="kubernetes.io/no-provisioner")
    storage.claim(scene, "c0", namespace="default", kind="lazy", size="5Gi")
    storage.mount(scene.pod, "c0")
    for name, size, zone in (("pv0", "10Gi", "z0"), ("pv1", "20Gi", "z1"), ("pv2", "40Gi", "z1"), ("pv3", "4Gi", "z1")):
        term = {"matchExpressions": [{"key": ZONE, "operator": "In", "values": [zone]}]}
        volume = storage.volume(scene, name, size=size, kind="lazy")
        volume["spec"]["nodeAffinity"] = {"required": {"nodeSelectorTerms": [term]}}
    # 5 of 10 leaves 50, 5 of 20 leaves 75.
    assert run_scene(scene).raw["VolumeBinding"] == {"n0": 50, "n1": 75}
    assert "VolumeBinding" not in run_scene(scene, compat_version="1.35").raw
