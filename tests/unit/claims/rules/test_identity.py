import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims.objects import app_holder, device_claim, domain_claim, pod_holder

from robotapp_api.model.claim import RobotClaim
from robotapp_api.values.naming import DNS_LABEL
from robotapp_claims.rules import identity
from robotapp_claims.rules.identity import Found

ids = st.sets(st.integers(0, 232), min_size=1, max_size=40)
texts = st.text(min_size=1, max_size=80)


def test_the_name_says_pool_scope_and_id() -> None:
    assert identity.claim_name_domain("default", "Cluster", "", 7) == "dds.default.c.7"
    node = identity.claim_name_domain("radio", "Node", "amr-07", 101)
    zone = identity.claim_name_domain("radio", "Zone", "amr-07", 101)
    assert node == f"dds.radio.n{identity.hash10('amr-07')}.101"
    assert zone == node.replace(".n", ".z")


@given(texts)
def test_every_device_id_becomes_a_dns_label_and_dns_labels_stay_themselves(text: str) -> None:
    label = identity.device_label(text)
    assert DNS_LABEL.fullmatch(label)
    assert identity.device_label(label) == label


@given(texts, texts)
def test_different_device_ids_have_different_labels(one: str, other: str) -> None:
    assert (identity.device_label(one) == identity.device_label(other)) == (one == other) or (
        one == identity.device_label(other) or other == identity.device_label(one)
    )


@given(ids, st.text(max_size=8), st.text(max_size=8))
def test_the_order_of_ids_is_a_permutation_that_ignores_the_order_given(
    numbers: set[int], uid: str, instance: str
) -> None:
    order = identity.id_order(numbers, uid, instance)
    assert set(order) == numbers
    assert order == identity.id_order(sorted(numbers, reverse=True), uid, instance)


def test_different_instances_begin_with_different_ids() -> None:
    first = {identity.id_order(range(1, 120), f"uid-{number}", "")[0] for number in range(200)}
    assert len(first) > 80, "200 apps would queue for the same few ids"


@given(ids, st.integers(0, 232))
def test_removing_an_id_keeps_the_order_of_the_others(numbers: set[int], gone: int) -> None:
    order = identity.id_order(numbers, "uid", "")
    assert identity.id_order(numbers - {gone}, "uid", "") == tuple(n for n in order if n != gone)


@pytest.mark.parametrize(
    ("other", "found"),
    [
        (domain_claim(7), Found.MINE),
        (domain_claim(7, app_holder(name="renamed")), Found.MINE),
        (domain_claim(7, app_holder("app-2")), Found.TAKEN),
        (domain_claim(7, app_holder(instance="amr-1")), Found.TAKEN),
        (domain_claim(7, app_holder(component="driver")), Found.TAKEN),
        (domain_claim(7, pool="other"), Found.COLLISION),
        (domain_claim(8), Found.COLLISION),
        (device_claim(), Found.COLLISION),
    ],
)
def test_a_claim_met_on_create_is_mine_taken_or_a_collision(other: object, found: Found) -> None:
    assert identity.same_tuple(domain_claim(7).spec, other.spec) is found  # type: ignore[attr-defined]  # all are claims


def test_a_device_is_named_by_node_and_id_alone() -> None:
    mine = identity.device_spec(node="n", device_type="can", device_id="can0", identity="", holder=app_holder())
    seen = identity.device_spec(node="n", device_type="?", device_id="can0", identity="usb:1:2", holder=app_holder())
    assert identity.same_tuple(mine, seen) is Found.MINE


@pytest.mark.parametrize("claim", [domain_claim(7), device_claim("usb:8086:0b3a:1"), domain_claim(3, pod_holder())])
def test_the_object_fits_the_model_and_reads_back_as_the_same_claim(claim: object) -> None:
    import msgspec

    from robotapp_claims.rules.objects import Claim

    assert isinstance(claim, Claim)
    obj = identity.claim_object(claim.spec)
    model = RobotClaim.model_validate(obj)
    assert model.metadata.name == claim.name
    assert msgspec.convert(obj, Claim).spec == claim.spec
    assert set(obj["metadata"]["annotations"]) == {"robotics.io/thing", "robotics.io/holder"}


def test_a_holder_in_another_namespace_stays_anonymous() -> None:
    holder = app_holder(instance="amr-07")
    assert identity.holder_text(holder, for_namespace="team") == "team/teleop (amr-07)"
    assert identity.holder_text(holder, for_namespace="other") == "another namespace"
    assert identity.holder_text(pod_holder(), for_namespace="team") == "pod team/pod"


@given(st.none() | st.integers(0, 232), st.sets(texts, max_size=4))
def test_grants_read_back_as_they_were_written(domain: int | None, devices: set[str]) -> None:
    given_annotations = identity.grants(domain=domain, devices=devices)
    assert identity.granted_domain(given_annotations) == domain
    assert identity.granted_devices(given_annotations) == {identity.device_label(device) for device in devices}


@pytest.mark.parametrize("text", ["", "seven", "-1", "7.0"])
def test_a_grant_that_is_no_number_grants_nothing(text: str) -> None:
    assert identity.granted_domain({"granted.robotics.io/dds-domain": text}) is None
