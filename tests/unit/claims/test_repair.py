import pytest
from tests.support.claims_objects import app_holder, device_claim, domain_claim, labels, pod, pod_holder

from robotapp_api.claims.objects import Pod
from robotapp_api.claims.repair import conflicts, missing_claims

LOCK = {"robotics.io/domain-claim": "dds.default.c.7"}
BOTH = {"granted.robotics.io/dds-domain": "7", "granted.robotics.io/devices": "can-can0"}


@pytest.mark.parametrize(
    ("running", "names"),
    [
        (pod(7, node="edge-1", annotations=LOCK), {"dds.default.c.7"}),
        (pod(7, annotations=LOCK), set()),
        (pod(7, node="edge-1", phase="Failed", annotations=LOCK), set()),
        (pod(8, node="edge-1", annotations=LOCK), set()),
        (pod(7, node="edge-1"), set()),
        (pod(of={}, node="edge-1", annotations=BOTH), {"dds.default.c.7", device_claim().name}),
        (pod(node="edge-1", annotations={"granted.robotics.io/devices": "can-can0"}), {device_claim().name}),
        (pod(7, node="edge-1", annotations={"robotics.io/domain-claim": "dds.default.zffff.7"}), set()),
    ],
)
def test_what_a_running_pod_stands_on_is_missed_when_it_is_not_there(running: Pod, names: set[str]) -> None:
    missing = missing_claims([running], {})
    assert set(missing) == names
    everything = {name: domain_claim(7) for name in names}
    assert missing_claims([running], everything) == {}


def test_a_claim_is_made_again_for_who_runs() -> None:
    (domain,) = missing_claims([pod(7, node="edge-1", annotations=LOCK)], {}).values()
    assert domain.spec.holder == app_holder()
    (device,) = missing_claims(
        [pod(node="edge-1", annotations={"granted.robotics.io/devices": "can-can0"})], {}
    ).values()
    assert device.spec.holder == app_holder(component="driver")
    assert device.pod_uid == "pod-1"


def test_a_claim_per_node_is_made_again_on_the_pods_node() -> None:
    from robotapp_api.claims.identity import claim_name_domain

    name = claim_name_domain("radio", "Node", "edge-1", 7)
    running = pod(7, node="edge-1", annotations={"robotics.io/domain-claim": name})
    assert set(missing_claims([running], {})) == {name}


def test_somebody_elses_claim_on_what_runs_is_a_conflict_told_without_names_of_other_tenants() -> None:
    running = pod(7, node="edge-1", annotations=LOCK)
    other = domain_claim(7, app_holder("app-2", name="thief"))
    (conflict,) = conflicts([running, running], {other.name: other})
    assert conflict.thing == "domain 7 of default"
    assert "team/thief" in conflict.message(for_namespace="team")
    assert "thief" not in conflict.message(for_namespace="elsewhere")
    assert conflicts([running], {"dds.default.c.7": domain_claim(7)}) == []


def test_a_bare_pods_own_claim_is_no_conflict() -> None:
    running = pod(of={}, node="edge-1", annotations=BOTH)
    own = [domain_claim(7, pod_holder()), device_claim(holder=pod_holder(), pod="pod-1")]
    assert conflicts([running], {claim.name: claim for claim in own}) == []
    assert labels()
