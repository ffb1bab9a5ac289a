import itertools

import pytest
from msgspec import structs
from tests.support.claims.objects import claim, device_claim, domain_claim, pod, pod_holder

from robotapp_api.model.names import ClaimPhase
from robotapp_claims.rules import release
from robotapp_claims.rules.objects import App, AppSpec, Component, Meta, Pod, Ros, Ros2, SharedApp
from robotapp_claims.rules.release import Release, release_domain


@pytest.mark.parametrize("flags", list(itertools.product([True, False], repeat=4)))
@pytest.mark.parametrize("phase", list(ClaimPhase))
def test_nothing_used_wanted_or_unseen_is_ever_deleted_and_nothing_skips_a_phase(
    flags: tuple[bool, ...], phase: ClaimPhase
) -> None:
    wanted, used, rested, unseen = flags
    decision = release_domain(phase=phase, wanted=wanted, used=used, rested=rested, unseen=unseen)
    standing = phase is ClaimPhase.RESERVED
    if wanted or used:
        assert decision is (Release.KEEP if standing else Release.RESTORE)
    elif unseen:
        assert decision is (Release.KEEP if phase == ClaimPhase.PARKED else Release.PARK)
    elif phase != ClaimPhase.DRAINING:
        assert decision is Release.DRAIN
    else:
        assert decision is (Release.DELETE if rested else Release.WAIT)


def test_a_node_is_seen_when_its_kubelet_reports_or_an_admin_has_said_so_of_this_parking() -> None:
    held = domain_claim(7, nodes=("amr-1", "edge-1"))
    assert release.unseen_nodes(held, ready=()) == ("amr-1", "edge-1")
    assert release.unseen_nodes(held, ready={"edge-1"}) == ("amr-1",)
    assert not release.unseen_nodes(held, ready={"edge-1", "amr-1", "other"})
    said = domain_claim(7, nodes=("amr-1",), confirmed=True)
    assert not release.unseen_nodes(said, ready=())
    adopted = structs.replace(said, status=structs.replace(said.status, attempt=said.status.attempt + 1))
    assert release.unseen_nodes(adopted, ready=()) == ("amr-1",)


def test_every_destructive_write_carries_uid_and_version() -> None:
    found = release.preconditions(claim(domain_claim(7).spec, uid="c", version="12"))
    assert (found.uid, found.resource_version) == ("c", "12")


def app(**ros2: object) -> App:
    return App(metadata=Meta(name="teleop", namespace="team", uid="app-1"), spec=AppSpec(ros2=Ros2(**ros2)))  # type: ignore[arg-type]  # a factory


def test_gone_is_a_404_or_another_uid() -> None:
    assert release.is_gone(None, "app-1")
    assert release.is_gone(app(), "app-2")
    assert not release.is_gone(app(), "app-1")


@pytest.mark.parametrize(
    ("spec", "wanted"),
    [
        (app(), True),
        (App(metadata=Meta(uid="app-1")), True),
        (app(domain=7), True),
        (app(domain=8), False),
        (app(pool="other"), False),
        (app(isolation="Discovery"), False),
        (App(metadata=Meta(uid="app-1"), spec=AppSpec(ros=Ros(version=1))), False),
        (App(metadata=Meta(uid="app-1"), spec=AppSpec(ros=Ros(distro="noetic"))), False),
    ],
)
def test_an_app_wants_the_claim_its_spec_still_asks_for(spec: App, wanted: bool) -> None:
    held = domain_claim(7)
    assert release.wants_domain(spec, held, [held], named=()) is wanted


@pytest.mark.parametrize(("named", "wanted"), [((), True), ((7,), True), ((9,), False), ((7, 9), True)])
def test_who_shares_keeps_its_own_claim_until_its_deployments_name_anothers_id(
    named: tuple[int, ...], wanted: bool
) -> None:
    held = domain_claim(7)
    assert release.wants_domain(app(share_with=(SharedApp(name="b"),)), held, [held], named=named) is wanted


def test_of_two_claims_exactly_one_is_wanted_and_it_is_the_one_the_deployments_name() -> None:
    pair = [domain_claim(7), domain_claim(8)]
    for named in ((7,), (8,), ()):
        wanted = [c.spec.domain.id for c in pair if c.spec.domain and release.wants_domain(app(), c, pair, named=named)]
        assert len(wanted) == 1
        assert not named or wanted == list(named)


def test_an_app_without_a_ros2_section_never_wants_a_device_claim_as_domain() -> None:
    assert not release.wants_domain(app(), device_claim(), [], named=())


@pytest.mark.parametrize(
    ("ros", "components", "claims"),
    [
        ("jazzy", ["", ""], True),
        ("jazzy", ["", "None"], True),
        ("jazzy", ["None", "None"], False),
        ("none", [""], False),
        ("noetic", [""], False),
    ],
)
def test_an_app_claims_a_domain_while_a_component_uses_ros_2(ros: str, components: list[str], claims: bool) -> None:
    parts = tuple(Component(name=f"c{number}", ros=value) for number, value in enumerate(components))
    found = App(metadata=Meta(uid="app-1"), spec=AppSpec(ros=Ros(distro=ros), components=parts))
    assert release.claims_domain(found) is claims


@pytest.mark.parametrize(
    ("found", "lost"),
    [
        (None, True),
        (pod(uid="other", of={}), True),
        (pod(of={}), False),
        (pod(of={}, phase="Succeeded"), True),
        (pod(of={}, phase="Failed"), True),
        (pod(of={}, node="edge-1"), True),
        (pod(of={}, node="edge-1", annotations={"granted.robotics.io/dds-domain": "7"}), False),
        (pod(of={}, node="edge-1", annotations={"granted.robotics.io/dds-domain": "8"}), True),
    ],
)
def test_a_bare_pod_loses_its_domain_when_gone_ended_or_bound_without_it(found: Pod | None, lost: bool) -> None:
    assert release.pod_lost(found, domain_claim(7, pod_holder())) is lost


@pytest.mark.parametrize(
    ("node", "granted", "lost"), [("edge-1", "a,can-can0", False), ("edge-2", "can-can0", True), ("edge-1", "a", True)]
)
def test_a_bare_pods_device_must_be_granted_on_its_own_node(node: str, granted: str, lost: bool) -> None:
    found = pod(of={}, node=node, annotations={"granted.robotics.io/devices": granted})
    assert release.pod_lost(found, device_claim(holder=pod_holder())) is lost
