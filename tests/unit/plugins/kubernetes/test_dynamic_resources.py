"""Pods with resource claims: refused while one is not allocated, then placed where the devices are."""

from typing import Any

import msgspec
import pytest
from tests.support.scheduling import make_core, make_info, make_node, make_pod, to_pod

from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.resource_claims import ResourceClaim
from robotapp_scheduler.plugins.kubernetes.dynamic_resources import DynamicResources

NOT_ALLOCATED = "resource claim 'camera' is not allocated; this scheduler does not allocate devices"
CAMERA = {"name": "camera", "resourceClaimName": "camera"}
BY_TEMPLATE = {"name": "camera", "resourceClaimTemplateName": "cameras"}


def claim(*nodes: str, name: str = "camera", allocated: bool = True, **fields: Any) -> ResourceClaim:
    """Allocated on these nodes, on all without any."""
    term = {"matchExpressions": [{"key": "kubernetes.io/hostname", "operator": "In", "values": list(nodes)}]}
    allocation = {"nodeSelector": {"nodeSelectorTerms": [term]}} if nodes else {}
    raw = {
        "metadata": {"name": name, "namespace": "default", **fields.pop("metadata", {})},
        "status": {**({"allocation": allocation} if allocated else {}), **fields},
    }
    return msgspec.convert(raw, ResourceClaim)


def camera(name: str = "p", **fields: Any) -> PodInfo:
    return make_info(name, resourceClaims=[CAMERA], **fields)


def by_template(status: list[dict[str, str]] | None) -> PodInfo:
    pod = make_pod("p", resourceClaims=[BY_TEMPLATE])
    raw = msgspec.to_builtins(pod)
    raw["status"] = {"resourceClaimStatuses": status or []}
    return PodInfo(to_pod(raw))


@pytest.fixture
def core() -> SchedulerCore:
    return make_core(*(make_node(name) for name in ("n1", "n2", "n3")))


def tried(core: SchedulerCore, pod: PodInfo) -> str:
    """Its node, or why it has none."""
    decision = core.schedule_one(pod, assume=False)
    return decision.node or decision.message


def test_a_pod_waits_until_its_claim_is_there_and_allocated_and_goes_where_the_device_is(core: SchedulerCore) -> None:
    claims = core.cluster.resource_claims
    assert NOT_ALLOCATED in tried(core, camera())
    claims.apply(claim(allocated=False))
    assert NOT_ALLOCATED in tried(core, camera())
    claims.apply(claim("n3"))
    assert tried(core, camera()) == "n3"
    claims.apply(claim("n1"))
    assert tried(core, camera()) == "n1", "a cached answer would still say n3"
    claims.apply(claim("gone"))
    assert "3 resourceclaim not available on the node" in tried(core, camera())
    claims.remove(claim("gone"))
    assert NOT_ALLOCATED in tried(core, camera())


def test_all_claims_of_a_pod_count_and_those_of_other_namespaces_do_not(core: SchedulerCore) -> None:
    claims = core.cluster.resource_claims
    claims.apply(claim("n1", "n2"))
    claims.apply(claim("n2", "n3", name="arm"))
    both = [CAMERA, {"name": "arm", "resourceClaimName": "arm"}]
    assert tried(core, make_info("p", resourceClaims=both)) == "n2"
    assert NOT_ALLOCATED in tried(core, camera(namespace="elsewhere"))


def test_a_claim_made_from_a_template_is_found_by_the_pods_status(core: SchedulerCore) -> None:
    mine = {"ownerReferences": [{"kind": "Pod", "name": "p", "uid": "uid-p"}]}
    core.cluster.resource_claims.apply(claim("n2", name="p-camera-x", metadata=mine))
    core.cluster.resource_claims.apply(claim("n2", name="q-camera-x"))
    assert NOT_ALLOCATED in tried(core, by_template(None))
    assert tried(core, by_template([{"name": "camera", "resourceClaimName": "p-camera-x"}])) == "n2"
    assert "was made for another pod" in tried(
        core, by_template([{"name": "camera", "resourceClaimName": "q-camera-x"}])
    )
    assert tried(core, by_template([{"name": "camera"}])) in {"n1", "n2", "n3"}, "no claim was needed"


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (claim(metadata={"deletionTimestamp": "2026-01-01T00:00:00Z"}), "is being deleted"),
        (
            claim(reservedFor=[{"resource": "pods", "uid": f"u{i}"} for i in range(256)]),
            "is shared by 256 pods already",
        ),
    ],
)
def test_a_claim_that_takes_no_more_users_refuses(core: SchedulerCore, found: ResourceClaim, text: str) -> None:
    core.cluster.resource_claims.apply(found)
    assert text in tried(core, camera())


def test_a_pod_that_uses_a_full_claim_already_may_go_on(core: SchedulerCore) -> None:
    users = [{"resource": "pods", "uid": f"u{i}"} for i in range(255)] + [{"resource": "pods", "uid": "uid-p"}]
    core.cluster.resource_claims.apply(claim("n1", reservedFor=users))
    assert tried(core, camera()) == "n1"


def test_only_news_of_its_own_claims_or_nodes_bring_a_pod_back() -> None:
    plugin, pod = DynamicResources(), camera()

    def wakes(change: Change, resource: str, old: Any, new: Any) -> bool:
        return plugin.hint(pod, Event(resource, change, old, new))

    news = Change.RESOURCE_CLAIMS
    assert wakes(news, "resourceclaims", None, claim())
    assert not wakes(news, "resourceclaims", None, claim(name="other"))
    assert not wakes(news, "resourceclaims", claim(metadata={"namespace": "b"}), None)
    assert wakes(Change.NODE_ADDED, "nodes", None, make_node("n9"))
    before, after = by_template(None).pod, by_template([{"name": "camera", "resourceClaimName": "x"}]).pod
    assert plugin.hint(by_template(None), Event("pods", Change.SELF, before, after))
    assert not plugin.hint(by_template(None), Event("pods", Change.SELF, before, before))


def test_a_claim_whose_status_stays_as_it_was_is_no_news(core: SchedulerCore) -> None:
    claims = core.cluster.resource_claims
    assert claims.apply(claim("n1")) is Change.RESOURCE_CLAIMS
    assert claims.apply(claim("n1", metadata={"labels": {"a": "b"}})) is Change.NONE
    assert claims.remove(claim(name="unknown")) is Change.NONE


def test_pods_without_claims_share_their_class_whatever_claims_there_are() -> None:
    plain = make_info("plain")
    assert DynamicResources.reads == ("resource_claims",)
    assert plain.features(DynamicResources.reads) == (None,)
    assert camera("a").features(DynamicResources.reads) == camera("b").features(DynamicResources.reads)
