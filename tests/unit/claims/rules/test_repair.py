import pytest
from tests.support.claims.objects import app_holder, claim, device_claim, domain_claim, labels, pod, pod_holder

from robotapp_claims.rules.identity import claim_name_domain, domain_spec
from robotapp_claims.rules.objects import DomainThing, Meta, Pod
from robotapp_claims.rules.repair import conflicts, missing_claims, places_of, requested_places

PLACES: dict[str, str] = {}
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
    missing = missing_claims([running], {}, places=PLACES)
    assert set(missing) == names
    everything = {name: domain_claim(7) for name in names}
    assert missing_claims([running], everything, places=PLACES) == {}


def test_a_claim_is_made_again_for_who_runs() -> None:
    (domain,) = missing_claims([pod(7, node="edge-1", annotations=LOCK)], {}, places=PLACES).values()
    assert domain.spec.holder == app_holder()
    driver = pod(node="edge-1", annotations={"granted.robotics.io/devices": "can-can0"})
    (device,) = missing_claims([driver], {}, places=PLACES).values()
    assert device.spec.holder == app_holder(component="driver")
    assert device.pod_uid == "pod-1"


@pytest.mark.parametrize(("scope", "value"), [("Zone", "hall-1"), ("Node", "robot-1")])
def test_a_claim_per_zone_or_node_is_made_again_wherever_the_pod_runs(scope: str, value: str) -> None:
    name = claim_name_domain("radio", scope, value, 7)
    running = pod(7, node="edge-1", annotations={"robotics.io/domain-claim": name})
    assert missing_claims([running], {}, places=PLACES) == {}
    assert requested_places([running]) == {name.split(".")[2]}
    robot = Meta(name="robot-1", labels={"topology.kubernetes.io/zone": "hall-1"})
    (missing,) = missing_claims([running], {}, places=places_of((), nodes=[robot])).values()
    assert missing.spec.domain == DomainThing(pool="radio", scope=scope, scope_value=value, id=7)
    neighbour = claim(
        domain_spec(pool="radio", scope=scope, scope_value=value, domain_id=8, holder=app_holder("app-2"))
    )
    assert set(missing_claims([running], {}, places=places_of([neighbour]))) == {name}


def test_nobody_need_look_for_the_places_of_claims_for_the_whole_cluster() -> None:
    ended = pod(7, node="edge-1", phase="Failed", annotations={"robotics.io/domain-claim": "dds.radio.zffff.7"})
    assert requested_places([pod(7, node="edge-1", annotations=LOCK), pod(7, node="edge-1"), ended]) == set()


def test_somebody_elses_claim_on_what_runs_is_a_conflict_told_without_names_of_other_tenants() -> None:
    running = pod(7, node="edge-1", annotations=LOCK)
    other = domain_claim(7, app_holder("app-2", name="thief"))
    (conflict,) = conflicts([running, running], {other.name: other}, places=PLACES)
    assert conflict.thing == "domain 7 of default"
    assert "team/thief" in conflict.message(for_namespace="team")
    assert "thief" not in conflict.message(for_namespace="elsewhere")
    assert conflicts([running], {"dds.default.c.7": domain_claim(7)}, places=PLACES) == []


def test_a_bare_pods_own_claim_is_no_conflict() -> None:
    running = pod(of={}, node="edge-1", annotations=BOTH)
    own = [domain_claim(7, pod_holder()), device_claim(holder=pod_holder(), pod="pod-1")]
    assert conflicts([running], {each.name: each for each in own}, places=PLACES) == []
    assert labels()
