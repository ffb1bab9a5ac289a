import pytest
from tests.support.claims.objects import app_holder, domain_claim, labels, pod, pod_holder

from robotapp_api.model.names import PodReason
from robotapp_claims.rules.bind import bind_verdict, needs_check, shared_verdict
from robotapp_claims.rules.objects import Claim, Container, EnvVar, Pod, PodSpec


@pytest.mark.parametrize(
    ("claim", "allowed"),
    [
        (domain_claim(7), True),
        (domain_claim(7, phase="Reserved"), True),
        (domain_claim(7, phase="Draining"), False),
        (domain_claim(8), False),
        (domain_claim(7, app_holder("app-2")), False),
        (domain_claim(7, app_holder(instance="amr-1")), False),
        (domain_claim(7, pod_holder("app-1")), False),
        (None, False),
    ],
)
def test_a_pod_may_be_bound_only_while_its_own_claim_stands(claim: Claim | None, allowed: bool) -> None:
    verdict = bind_verdict(pod(7), claim)
    assert verdict.allowed is allowed
    assert bool(verdict.message) is not allowed
    assert verdict.reason == ("" if allowed else PodReason.WAITING_FOR_DOMAIN)


def test_a_claim_of_another_namespace_is_not_ones_own() -> None:
    stranger = pod(7)
    moved = Pod(metadata=type(stranger.metadata)(name="pod", namespace="other", labels=labels()), spec=stranger.spec)
    assert not bind_verdict(moved, domain_claim(7)).allowed


def test_sharing_on_purpose_is_allowed_but_not_while_the_owner_gives_up() -> None:
    sharer = pod(7, of=labels("app-2"))
    assert not bind_verdict(sharer, domain_claim(7)).allowed
    assert bind_verdict(sharer, domain_claim(7), sharing=("app-1",)).allowed
    assert not bind_verdict(sharer, domain_claim(7, phase="Draining"), sharing=("app-1",)).allowed


def test_containers_that_disagree_about_the_domain_are_refused() -> None:
    verdict = bind_verdict(pod(7, 8), domain_claim(7))
    assert not verdict.allowed
    assert "7, 8" in verdict.message


@pytest.mark.parametrize(
    ("candidate", "needed"), [(pod(7), True), (pod(), False), (pod(7, of={}), False), (pod("auto"), True)]
)
def test_only_children_whose_environment_sets_a_domain_are_checked(candidate: Pod, needed: bool) -> None:
    assert needs_check(candidate) is needed


def test_a_shared_id_needs_no_claim() -> None:
    assert shared_verdict(pod(91), (90, 91)).allowed
    assert not shared_verdict(pod(7), (90, 91)).allowed
    assert not shared_verdict(pod(), (90, 91)).allowed


@pytest.mark.parametrize("written", ["0x8", " 8", "+8", "010", "8 ", "\u0668", "9" * 5000])
def test_a_domain_written_in_another_way_is_checked_and_refused_whatever_claim_stands(written: str) -> None:
    odd = pod(written)
    assert needs_check(odd)
    verdict = bind_verdict(odd, domain_claim(8))
    assert not verdict.allowed
    assert "plain decimal number" in verdict.message
    assert len(verdict.message) < 200
    assert not shared_verdict(odd, {8}).allowed


def test_a_domain_taken_from_elsewhere_is_refused() -> None:
    variable = EnvVar(name="ROS_DOMAIN_ID", value_from={"fieldRef": {"fieldPath": "metadata.labels['x']"}})
    odd = Pod(metadata=pod(7).metadata, spec=PodSpec(containers=(Container(env=(variable,)),)))
    assert needs_check(odd)
    assert not bind_verdict(odd, domain_claim(7)).allowed


def test_an_empty_domain_names_nothing() -> None:
    assert not needs_check(pod(""))
