"""Which device keeps an instance waiting, and who holds it."""

import itertools
import time
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app, make_node
from tests.support.work_unit import is_within

from robotapp_api.model.names import Annotation
from robotapp_claims.rules.identity import claim_name_device
from robotapp_claims.rules.instances import Instance
from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.spec.desired import App, desired_of
from robotapp_operator.plan.spec.objects import Telemetry
from robotapp_operator.plan.status import device_conflicts as devices
from robotapp_operator.plan.status.device_conflicts import Place, PodDevices, rivals

ON_ROBOT = Instance(robot="amr-07", node="amr-07")
BUS: dict[str, Any] = {"name": "bus", "type": "can", "interface": "can0"}
WANTING = make_app(component(devices=[BUS]))


NODES = {
    "amr-07": make_node("amr-07", robot="amr-07", tier="robot"),
    "amr-08": make_node("amr-08", robot="amr-08", tier="robot"),
    "edge-1": make_node("edge-1", tier="edge"),
    "edge-2": make_node("edge-2", tier="edge"),
}


def device_trouble(app: App, instance: Instance, *, telemetry: dict[str, Telemetry], claims: list[Claim]) -> str:
    return devices.device_trouble(
        app, instance, claims={claim.name: claim for claim in claims}, telemetry=telemetry, nodes=NODES
    )


def node_with(*devices: str, node: str = "amr-07") -> dict[str, Telemetry]:
    """Telemetry of one node with CAN buses of these ids."""
    listed = [{"id": f"can-{each}", "type": "can", "interface": each} for each in devices]
    return {node: msgspec.convert({"metadata": {"name": node}, "status": {"devices": listed}}, Telemetry)}


def claim_of(device: str, *, uid: str, namespace: str = "default", node: str = "amr-07") -> Claim:
    holder = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "arm", "uid": uid}
    thing = {"node": node, "type": "can", "id": device}
    body = {
        "metadata": {"name": claim_name_device(node, device), "uid": "c", "resourceVersion": "1"},
        "spec": {"device": thing, "holder": {**holder, "namespace": namespace, "instance": "amr-07", "component": "x"}},
    }
    return msgspec.convert(body, Claim)


def test_a_device_held_by_another_app_is_named_with_its_holder() -> None:
    text = device_trouble(WANTING, ON_ROBOT, claims=[claim_of("can-can0", uid="other")], telemetry=node_with("can0"))
    assert text.startswith("device can-can0 on amr-07 is held by default/arm")


def test_a_device_that_would_be_shared_and_is_held_by_one_alone_is_named_with_its_holder() -> None:
    sharing = make_app(component(devices=[BUS | {"sharing": "Cluster"}]))
    held = claim_of("can-can0", uid="other")
    text = device_trouble(sharing, ON_ROBOT, claims=[held], telemetry=node_with("can0"))
    assert text.startswith("device can-can0 on amr-07 is held by default/arm")
    assert device_trouble(sharing, ON_ROBOT, claims=[held], telemetry=node_with("can0", "can1")) != ""
    assert device_trouble(sharing, ON_ROBOT, claims=[], telemetry=node_with("can0")) == ""


def test_holders_of_other_namespaces_are_not_named() -> None:
    foreign = claim_of("can-can0", uid="other", namespace="team-b")
    text = device_trouble(WANTING, ON_ROBOT, claims=[foreign], telemetry=node_with("can0"))
    assert "another namespace" in text
    assert "arm" not in text


def test_a_device_that_was_claimed_under_the_name_of_a_label_is_held_when_an_agent_reports_it() -> None:
    text = device_trouble(WANTING, ON_ROBOT, claims=[claim_of("can", uid="other")], telemetry=node_with("can0"))
    assert text.startswith("device can on amr-07 is held by default/arm")


def test_devices_of_robots_that_do_not_admit_the_app_are_not_talked_about() -> None:
    nodes = NODES | {"edge-1": make_node("edge-1", tier="edge", annotations={Annotation.ALLOWED_NAMESPACES: "other"})}
    held = claim_of("can-can0", uid="other", node="edge-1")
    told = [
        devices.device_trouble(
            WANTING, Instance(), claims={held.name: held}, telemetry=node_with("can0", node="edge-1"), nodes=seen
        )
        for seen in (NODES, nodes)
    ]
    assert "edge-1" in told[0]
    assert told[1] == ""


@pytest.mark.parametrize(
    ("claims", "telemetry"),
    [
        pytest.param([], node_with("can0"), id="a free device"),
        pytest.param([claim_of("can-can0", uid="uid-1")], node_with("can0"), id="its own device"),
        pytest.param([claim_of("can-can1", uid="other")], node_with("can0", "can1"), id="another device"),
        pytest.param(
            [claim_of("can-can0", uid="other", node="amr-08")], node_with("can0", node="amr-08"), id="another robot"
        ),
    ],
)
def test_nothing_is_said_about(claims: list[Claim], telemetry: dict[str, Telemetry]) -> None:
    assert device_trouble(WANTING, ON_ROBOT, claims=claims, telemetry=telemetry) == ""


def test_an_app_without_robots_waits_only_when_every_fitting_device_anywhere_is_held() -> None:
    both = node_with("can0", node="edge-1") | node_with("can0", node="edge-2")
    held = [claim_of("can-can0", uid="other", node=node) for node in both]
    assert device_trouble(WANTING, Instance(), claims=held[:1], telemetry=both) == ""
    assert "edge-1" in device_trouble(WANTING, Instance(), claims=held, telemetry=both)


# Components of one app that want the same


def both(**second: Any) -> App:
    return make_app(component("l", runsOn=["Robot"], devices=[BUS]), component("r", devices=[BUS], **second))


def test_two_components_that_want_one_device_are_told_that_one_must_go() -> None:
    text = device_trouble(both(runsOn=["Robot"]), ON_ROBOT, claims=[], telemetry=node_with("can0", "can1"))
    assert text == ("l and r both want can-can0 on amr-07, which only one can have: remove the device from one of them")


def test_a_count_that_no_node_has_is_told_with_what_there_is() -> None:
    app = make_app(component("l", runsOn=["Robot"], devices=[ANY_BUS | {"count": 3}]))
    two, three = (node_with(*(f"can{i}" for i in range(count))) for count in (2, 3))
    assert device_trouble(app, ON_ROBOT, claims=[], telemetry=two) == (
        "l wants 3 devices, but only can-can0 on amr-07 and can-can1 on amr-07 would do: remove a device or lower its count"
    )
    assert device_trouble(app, ON_ROBOT, claims=[], telemetry=three) == ""


def test_that_one_of_them_holds_it_changes_nothing_and_somebody_else_is_not_the_reason() -> None:
    for uid in ("uid-1", "other"):
        claims = [claim_of("can-can0", uid=uid)]
        text = device_trouble(both(runsOn=["Robot"]), ON_ROBOT, claims=claims, telemetry=node_with("can0"))
        assert text.startswith("l and r both want can-can0 on amr-07")


def test_a_component_that_may_run_elsewhere_takes_the_device_there() -> None:
    fleet = node_with("can0") | node_with("can0", node="edge-1") | node_with("can0", node="amr-08")
    where: list[str]
    for where in (["Edge"], ["Cloud", "Edge"], []):
        assert device_trouble(both(runsOn=where), ON_ROBOT, claims=[], telemetry=fleet) == ""
    elsewhere = [claim_of("can-can0", uid="other", node="edge-1")]
    assert "on edge-1 is held" in device_trouble(both(runsOn=["Edge"]), ON_ROBOT, claims=elsewhere, telemetry=fleet)


def test_a_component_that_wants_more_than_there_is_is_named_with_its_requests() -> None:
    bus = {"type": "can"}
    greedy = make_app(
        component("l", runsOn=["Robot"], devices=[{**bus, "name": "front"}, {**bus, "name": "rear"}]),
        component("r", runsOn=["Robot"], devices=[{**bus, "name": "arm"}]),
    )
    text = device_trouble(greedy, ON_ROBOT, claims=[], telemetry=node_with("can0", "can1"))
    assert text == (
        "l (front), l (rear) and r want 3 devices, but only can-can0 on amr-07 and can-can1 on amr-07 would do: "
        "remove a device from one of them"
    )


def test_a_component_with_a_node_selector_takes_only_what_is_there() -> None:
    fleet = node_with("can0") | node_with("can0", node="edge-1")
    app = both(template={"spec": {"nodeSelector": {"robotics.io/robot": "amr-07"}}})
    assert device_trouble(app, ON_ROBOT, claims=[], telemetry=fleet).startswith("l and r both want")


PLACES = st.frozensets(st.sampled_from([Place("n", name) for name in "abcd"]), min_size=1)


@given(st.lists(PLACES, max_size=5))
def test_rivals_cannot_all_be_served_but_all_without_any_one_of_them(fitting: list[frozenset[Place]]) -> None:
    def served(group: list[int]) -> bool:
        return any(
            all(place in fitting[index] for index, place in zip(group, chosen, strict=True))
            for chosen in itertools.permutations([Place("n", name) for name in "abcd"], len(group))
        )

    group = rivals(fitting)
    assert served(group) is (not group)
    assert served(list(range(len(fitting)))) is (not group)
    for index in group:
        assert served([other for other in group if other != index])


MANY = [make_node(f"n{number:04}", tier="edge") for number in range(1000)]


def fleet_with_videos() -> dict[str, Telemetry]:
    """A thousand nodes with four cameras each, one of them with a CAN bus."""
    videos = [{"id": f"video-{number}", "type": "video", "interface": f"v{number}"} for number in range(4)]
    bus = {"id": "can-can0", "type": "can", "interface": "can0"}
    listed = {node.metadata.name: [*videos, *([bus] if not number else [])] for number, node in enumerate(MANY)}
    return {
        node: msgspec.convert({"metadata": {"name": node}, "status": {"devices": found}}, Telemetry)
        for node, found in listed.items()
    }


def test_an_app_with_all_devices_a_spec_can_ask_for_does_not_hold_up_the_operator() -> None:
    """One app of one tenant kept the only event loop busy for half a minute, again after every claim of anybody."""
    videos = [{"name": f"v{number}", "type": "video", "count": 16} for number in range(15)]
    app = make_app(component(devices=[{"name": "bus", "type": "can", "count": 2}, *videos]))
    telemetry, nodes = fleet_with_videos(), {node.metadata.name: node for node in MANY}
    parts = (component(f"c{number}", devices=[ANY_BUS | {"name": f"d{i}"} for i in range(16)]) for number in range(64))
    begin_s = time.process_time()
    assert devices.device_trouble(make_app(*parts), Instance(), claims={}, telemetry=telemetry, nodes=nodes)
    text = devices.device_trouble(app, Instance(), claims={}, telemetry=telemetry, nodes=nodes)
    found = devices.free_elsewhere(
        app.spec.components[0],
        desired_of(app, ""),
        but="n0000",
        claims={},
        used=NOTHING_USED,
        telemetry=telemetry,
        nodes=nodes,
    )
    assert text.startswith("driver wants 2 devices, but only can-can0 on n0000 would do")
    assert found == ""
    assert is_within(time.process_time() - begin_s, 5)


@pytest.mark.parametrize(("wanted", "there"), [(256, 255), (256, 128)])
def test_more_requests_than_devices_are_seen_at_once(wanted: int, there: int) -> None:
    begin_s = time.process_time()
    places = frozenset(Place("n", str(number)) for number in range(there))
    assert rivals([places] * wanted) == list(range(there + 1))
    assert is_within(time.process_time() - begin_s, 2)


def test_a_device_that_is_asked_for_by_a_further_name_is_the_one_that_is_held() -> None:
    listed = [{"id": "can-1d50-606f-1", "type": "can", "interface": "can3", "present": True, "names": ["can-can0"]}]
    telemetry = {"amr-07": msgspec.convert({"metadata": {"name": "amr-07"}, "status": {"devices": listed}}, Telemetry)}
    text = device_trouble(WANTING, ON_ROBOT, claims=[claim_of("can-1d50-606f-1", uid="other")], telemetry=telemetry)
    assert text.startswith("device can-1d50-606f-1 on amr-07 is held by default/arm")


NOTHING_USED = PodDevices({}, {})


def elsewhere(
    *wanted: dict[str, Any],
    telemetry: dict[str, Telemetry],
    claims: list[Claim] | None = None,
    used: PodDevices = NOTHING_USED,
) -> str:
    """The node to which a component with these devices may move from edge-1."""
    app = make_app(component(runsOn=["Edge"], devices=list(wanted)))
    return devices.free_elsewhere(
        app.spec.components[0],
        desired_of(app, ""),
        but="edge-1",
        claims={claim.name: claim for claim in claims or []},
        used=used,
        telemetry=telemetry,
        nodes=NODES,
    )


ANY_BUS: dict[str, Any] = {"name": "bus", "type": "can"}


def test_a_pod_may_move_to_where_all_devices_are_that_it_asks_for() -> None:
    """Evicted for fewer it would wait there, or nowhere, and had at least run before."""
    one, two = node_with("can0", node="edge-2"), node_with("can0", "can1", node="edge-2")
    assert elsewhere(ANY_BUS, telemetry=one) == "edge-2"
    assert elsewhere(ANY_BUS | {"count": 2}, telemetry=one) == ""
    assert elsewhere(ANY_BUS | {"count": 2}, telemetry=two) == "edge-2"
    held = [claim_of("can-can1", uid="other", node="edge-2")]
    assert elsewhere(ANY_BUS | {"count": 2}, telemetry=two, claims=held) == ""


def test_a_pod_may_not_move_to_where_a_device_that_it_shares_is_missing_or_held_by_one_alone() -> None:
    shared = {"name": "log", "type": "can", "interface": "can1", "sharing": "Cluster"}
    bus = ANY_BUS | {"interface": "can0"}
    both = node_with("can0", "can1", node="edge-2")
    assert elsewhere(bus, shared, telemetry=both) == "edge-2"
    assert elsewhere(bus, shared, telemetry=node_with("can0", node="edge-2")) == ""
    assert elsewhere(bus, shared, telemetry=both, claims=[claim_of("can-can1", uid="o", node="edge-2")]) == ""


def test_a_pod_may_not_move_to_a_device_that_others_share_or_that_a_bare_pod_holds_before_its_claim_is_there() -> None:
    two = node_with("can0", "can1", node="edge-2")
    shared, alone = PodDevices({}, {"edge-2": {"can-can0"}}), PodDevices({"edge-2": {"can-can0"}}, {})
    bus, log = ANY_BUS | {"interface": "can0"}, ANY_BUS | {"name": "log", "interface": "can0", "sharing": "Cluster"}
    other = ANY_BUS | {"name": "other", "interface": "can1"}
    for used in (shared, alone):
        assert elsewhere(bus, telemetry=two, used=used) == ""
        assert elsewhere(other, telemetry=two, used=used) == "edge-2"
        assert elsewhere(bus, telemetry=two, used=PodDevices({"edge-1": {"can-can0"}}, {})) == "edge-2"
    assert elsewhere(other, log, telemetry=two, used=shared) == "edge-2", "one more may share it"
    assert elsewhere(other, log, telemetry=two, used=alone) == ""
