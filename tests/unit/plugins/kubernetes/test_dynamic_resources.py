"""Pods with resource claims: held while one is missing, allocated on a node with free devices, placed where the devices are."""

from typing import Any

import msgspec
import pytest
from tests.support.scheduler.allocations import make_device, make_request, make_resource_claim, make_slice
from tests.support.scheduler.devices import DRIVER, allocated_on, claim, device_class, wanting, with_devices
from tests.support.scheduling import make_core, make_info, make_node, make_pod, to_pod

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.cycle.group_gates import groups_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.dynamic_resources.allocator import (
    MOST_STEPS,
    SEARCH_ENDED,
    STEPS_PER_DEVICE,
    STEPS_PER_NODE,
    Search,
)
from robotapp_scheduler.core.dynamic_resources.claim_cache import NOT_SERVED
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.kubernetes.dynamic_resources.node_allocations import LEAST_SHARE
from robotapp_scheduler.plugins.kubernetes.dynamic_resources.plugin import DynamicResources

NOWHERE = "3 cannot allocate all claims"
ELSEWHERE = "3 resourceclaim not available on the node"
BY_TEMPLATE = {"name": "camera", "resourceClaimTemplateName": "cameras"}
USER = {"resource": "pods", "name": "other", "uid": "uid-other"}


def camera(name: str = "p", **fields: Any) -> PodInfo:
    return wanting("camera", name=name, **fields)


def by_template(status: list[dict[str, str]] | None, name: str = "p") -> PodInfo:
    raw = msgspec.to_builtins(make_pod(name, resourceClaims=[BY_TEMPLATE]))
    raw["status"] = {"resourceClaimStatuses": status or []}
    return PodInfo(to_pod(raw))


@pytest.fixture
def core() -> SchedulerCore:
    core = make_core(*(make_node(name) for name in ("n1", "n2", "n3")))
    core.cluster.resource_claims.apply_class(device_class("cameras"))
    return core


def tried(core: SchedulerCore, pod: PodInfo) -> str:
    """Its node, or why it has none."""
    decision = core.schedule_one(pod, assume=False)
    return decision.node or decision.message


def gate_of(core: SchedulerCore, pod: PodInfo) -> str:
    gate = core._gate(pod)
    return gate.reason if gate is not None else ""


def test_a_pod_is_held_until_its_claim_is_there_and_then_goes_where_devices_are_free(core: SchedulerCore) -> None:
    claims = core.cluster.resource_claims
    assert gate_of(core, camera()) == 'could not find ResourceClaim "default/camera"'
    claims.apply_claim(claim("camera"))
    assert gate_of(core, camera()) == ""
    assert NOWHERE in tried(core, camera())
    with_devices(core.cluster, n2=1)
    assert tried(core, camera()) == "n2"


def test_devices_of_placed_pods_are_taken_at_once_and_free_again_when_the_pod_is_not_bound(core: SchedulerCore) -> None:
    with_devices(core.cluster, n2=1)
    for name in ("camera", "arm"):
        core.cluster.resource_claims.apply_claim(claim(name))
    first = core.schedule_one(camera())
    assert first.node == "n2"
    assert first.claims is not None
    assert NOWHERE in tried(core, wanting("arm", name="q"))
    assert core.cluster.forget("uid-p") & Change.RESOURCE_CLAIMS
    assert tried(core, wanting("arm", name="q")) == "n2"


def test_a_claim_whose_allocation_is_on_its_way_is_waited_for(core: SchedulerCore) -> None:
    with_devices(core.cluster, n1=1, n2=1)
    core.cluster.resource_claims.apply_claim(claim("camera"))
    core.schedule_one(camera())
    assert "resource claim default/camera is in the process of being allocated" in tried(core, camera("q"))
    core.cluster.resource_claims.apply_claim(claim("camera", allocated_on("n2"), version="7"))
    assert tried(core, camera("q")) == "n2"


def test_an_allocated_claim_is_followed_and_one_on_a_lost_node_nobody_uses_is_given_up(core: SchedulerCore) -> None:
    claims = core.cluster.resource_claims
    claims.apply_claim(claim("camera", allocated_on("n3")))
    assert tried(core, camera()) == "n3"
    claims.apply_claim(claim("camera", allocated_on("n1")))
    assert tried(core, camera()) == "n1", "a cached answer would still say n3"
    claims.apply_claim(claim("camera", allocated_on("gone")))
    decision = core.schedule_one(camera())
    assert ELSEWHERE in decision.message
    assert ". deallocation of ResourceClaim completed, preemption: 0/3 nodes are available: " in decision.message
    assert decision.deallocate is not None
    claims.apply_claim(claim("camera", allocated_on("gone"), reservedFor=[USER]))
    decision = core.schedule_one(camera())
    assert ELSEWHERE in decision.message
    assert decision.deallocate is None
    assert "deallocation" not in decision.message


def test_all_claims_of_a_pod_count_and_those_of_other_namespaces_do_not(core: SchedulerCore) -> None:
    claims = core.cluster.resource_claims
    claims.apply_claim(claim("camera", allocated_on("n1", "n2")))
    claims.apply_claim(claim("arm", allocated_on("n2", "n3")))
    assert tried(core, wanting("camera", "arm")) == "n2"
    assert "could not find ResourceClaim" in tried(core, camera(namespace="elsewhere"))


def test_two_references_to_one_claim_are_one_claim(core: SchedulerCore) -> None:
    with_devices(core.cluster, n1=1)
    core.cluster.resource_claims.apply_claim(claim("camera"))
    twice = [{"name": name, "resourceClaimName": "camera"} for name in ("left", "right")]
    decision = core.schedule_one(make_info("p", resourceClaims=twice))
    assert decision.node == "n1"
    assert decision.claims is not None
    assert len(decision.claims.claims) == 1


def test_a_claim_made_from_a_template_is_found_by_the_pods_status(core: SchedulerCore) -> None:
    owner = {"kind": "Pod", "name": "p", "uid": "uid-p", "controller": True}
    core.cluster.resource_claims.apply_claim(claim("p-camera-x", allocated_on("n2"), ownerReferences=[owner]))
    core.cluster.resource_claims.apply_claim(claim("q-camera-x", allocated_on("n2")))
    assert gate_of(core, by_template(None)) == 'pod "default/p": ResourceClaim not created yet'
    assert tried(core, by_template([{"name": "camera", "resourceClaimName": "p-camera-x"}])) == "n2"
    other = by_template([{"name": "camera", "resourceClaimName": "q-camera-x"}])
    assert (
        gate_of(core, other) == "ResourceClaim default/q-camera-x was not created for Pod default/p (Pod is not owner)"
    )
    assert tried(core, by_template([{"name": "camera"}])) in {"n1", "n2", "n3"}, "no claim was needed"


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (claim("camera", deletionTimestamp="2026-01-01T00:00:00Z"), 'resourceclaim "camera" is being deleted'),
        (
            claim("camera", allocated_on("n1"), reservedFor=[{"resource": "pods", "uid": f"u{i}"} for i in range(256)]),
            'resourceclaim "camera" is reserved for 256 consumers, which is the most',
        ),
    ],
)
def test_a_claim_that_takes_no_more_users_holds_the_pod_back(
    core: SchedulerCore, found: ResourceClaim, text: str
) -> None:
    core.cluster.resource_claims.apply_claim(found)
    assert gate_of(core, camera()) == text
    assert text in tried(core, camera())


def test_a_pod_that_uses_a_full_claim_already_may_go_on(core: SchedulerCore) -> None:
    users = [{"resource": "pods", "uid": f"u{i}"} for i in range(255)] + [{"resource": "pods", "uid": "uid-p"}]
    core.cluster.resource_claims.apply_claim(claim("camera", allocated_on("n1"), reservedFor=users))
    assert tried(core, camera()) == "n1"


def test_without_the_device_class_or_the_api_the_pod_is_refused_with_the_reason(core: SchedulerCore) -> None:
    claims = core.cluster.resource_claims
    claims.apply_claim(claim("camera", of_class="robots"))
    assert "request device: device class robots does not exist" in tried(core, camera())
    claims.served = False
    assert gate_of(core, camera()) == "", "a gated pod would get no condition"
    assert NOT_SERVED in tried(core, camera())
    assert tried(core, make_info("plain")) in {"n1", "n2", "n3"}


def test_only_news_about_its_claims_free_devices_or_nodes_bring_a_pod_back() -> None:
    plugin, pod = DynamicResources(), camera()

    def wakes(change: Change, resource: str, old: Any, new: Any) -> bool:
        return plugin.hint(pod, Event(resource, change, old, new))

    news = Change.RESOURCE_CLAIMS
    assert wakes(news, "resourceclaims", None, claim("camera"))
    assert not wakes(news, "resourceclaims", None, claim("other"))
    assert not wakes(news, "resourceclaims", claim("other"), claim("other", allocated_on("n1")))
    assert wakes(news, "resourceclaims", claim("other", allocated_on("n1")), claim("other")), "its devices are free"
    assert wakes(news, "resourceclaims", claim("other", allocated_on("n1")), None)
    assert not wakes(news, "resourceclaims", claim("camera", namespace="b"), None)
    assert wakes(Change.NODE_ADDED, "nodes", None, make_node("n9"))
    before, after = by_template(None).pod, by_template([{"name": "camera", "resourceClaimName": "x"}]).pod
    assert plugin.hint(by_template(None), Event("pods", Change.SELF, before, after))
    assert not plugin.hint(by_template(None), Event("pods", Change.SELF, before, before))


def test_the_end_of_a_pod_brings_back_those_that_name_its_claims_or_want_any_device() -> None:
    plugin, gone_pod = DynamicResources(), camera("first").pod
    ended = Change.POD_REMOVED | Change.RESOURCE_CLAIMS
    assert plugin.hint(camera(), Event("pods", ended, gone_pod))
    assert not plugin.hint(wanting("arm"), Event("pods", ended, gone_pod))
    assert plugin.hint(wanting("arm"), Event("pods", ended | Change.RESOURCE_SLICES, gone_pod))


def test_the_next_pod_of_a_robotapp_is_held_while_the_one_before_terminates(core: SchedulerCore) -> None:
    owner = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "a", "uid": "uid-a", "controller": True}
    users = [{"apiGroup": "robotics.io", "resource": "robotapps", "name": "a", "uid": "uid-a"}, USER]
    core.cluster.resource_claims.apply_claim(
        claim("camera", allocated_on("n1"), reservedFor=users, ownerReferences=[owner])
    )
    before = to_pod(
        {
            **msgspec.to_builtins(camera("other").pod),
            "metadata": {"name": "other", "namespace": "default", "uid": "uid-other"},
        }
    )
    before.spec.node_name = "n1"
    core.cluster.apply_pod(before)
    gate = core._gate(camera())
    assert gate is not None
    assert gate.reason == 'resourceclaim "camera" is still used by pod "other"'
    assert gate.code == PodReason.WAITING_FOR_PREDECESSOR, "a pod of somebody else may stay for ever, so it is told"
    change = core.cluster.remove_pod(before)
    assert change & DynamicResources.events
    assert gate_of(core, camera()) == ""
    assert tried(core, camera()) == "n1"


def test_news_of_a_claim_test_the_gates_of_the_pods_that_it_holds_back_and_of_no_other(
    core: SchedulerCore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Thousands of pods may wait for claims that come one by one: testing every gate each time would take minutes."""
    with_devices(core.cluster, n1=3)
    for number in range(3):
        core.queue.add(wanting(f"claim{number}", name=f"p{number}"))
    assert core.queue.pending()["gated"] == 3
    tested: list[str] = []
    gate = core.queue._gate
    monkeypatch.setattr(core.queue, "_gate", lambda pod: (tested.append(pod.name), gate(pod))[1])
    new = claim("claim1")
    event = Event("resourceclaims", core.cluster.resource_claims.apply_claim(new), None, new)
    core.queue.move(event, groups=groups_of(event))
    assert tested == ["p1"]
    assert [queued.info.name for queued in core.queue.pop()] == ["p1"]


def test_the_end_of_a_pod_opens_the_gate_of_the_next_one_that_names_its_claim(core: SchedulerCore) -> None:
    owner = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "a", "uid": "uid-a", "controller": True}
    users = [{"apiGroup": "robotics.io", "resource": "robotapps", "name": "a", "uid": "uid-a"}, USER]
    core.cluster.resource_claims.apply_claim(
        claim("camera", allocated_on("n1"), reservedFor=users, ownerReferences=[owner])
    )
    raw = msgspec.to_builtins(camera("other").pod)
    before = to_pod({**raw, "metadata": {"name": "other", "namespace": "default", "uid": "uid-other"}})
    before.spec.node_name = "n1"
    core.cluster.apply_pod(before)
    core.queue.add(camera())
    assert core.queue.pending()["gated"] == 1
    event = Event("pods", core.cluster.remove_pod(before), before, None)
    core.queue.move(event, groups=groups_of(event))
    assert core.queue.pending() == {"active": 1, "backoff": 0, "unschedulable": 0, "gated": 0}


def test_pods_with_equal_claims_share_their_class_and_pods_without_any_have_one() -> None:
    core = make_core(make_node("n1"))
    for name in ("camera", "arm"):
        core.cluster.resource_claims.apply_claim(claim(name))
    pods = [make_info("plain"), camera("a"), wanting("arm", name="b")]
    for pod in pods:
        core.prepare(pod)
    keys = [pod.live_features(DynamicResources.reads) for pod in pods]
    assert keys[0] == (None,)
    assert keys[1] == keys[2] != (None,)


def costly_claim(name: str, text: str = "true") -> ResourceClaim:
    """A claim of devices that stand in one place, of which there are too many combinations to try."""
    return make_resource_claim(
        make_request("r", text, deviceClassName="cameras", count=2),
        name=name,
        namespace="default",
        constraints=[{"matchAttribute": f"{DRIVER}/{attribute}"} for attribute in ("row", "column")],
    )


def test_an_attempt_on_many_nodes_ends_after_a_bounded_number_of_steps_and_the_pod_is_to_wait_longer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes = [f"n{i}" for i in range(100)]
    core = make_core(*map(make_node, nodes))
    core.cluster.resource_claims.apply_class(device_class("cameras"))
    grid = [make_device(f"d{i}", attributes={"row": i // 6, "column": i % 6}) for i in range(36)]
    for node in nodes:
        core.cluster.resource_claims.apply_slice(make_slice(*grid, driver=DRIVER, nodeName=node))
    steps: list[int] = []
    count_steps = Search._count_steps
    monkeypatch.setattr(Search, "_count_steps", lambda search, n: (steps.append(n), count_steps(search, n)))
    core.cluster.resource_claims.apply_claim(costly_claim("camera"))
    decision = core.schedule_one(camera())
    assert f"100 {SEARCH_ENDED}" in decision.message
    assert decision.costly
    own = (100 + MOST_STEPS // LEAST_SHARE) * (STEPS_PER_NODE + 36 * STEPS_PER_DEVICE)
    assert sum(steps) < own + 2 * MOST_STEPS
    steps.clear()
    core.cluster.resource_claims.apply_claim(costly_claim("twin"))
    assert core.schedule_one(wanting("twin", name="q")).costly
    assert steps == [], "pods with equal claims share what was computed"
    core.cluster.resource_claims.apply_claim(claim("simple"))
    assert core.schedule_one(wanting("simple", name="honest")).node in nodes
