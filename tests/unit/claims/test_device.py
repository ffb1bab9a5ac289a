import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims_objects import app_holder, device_claim, pod

from robotapp_api.claims import device
from robotapp_api.claims.device import PodUse, Take, choose_devices, release_device, take_device
from robotapp_api.claims.identity import claim_name_device
from robotapp_api.claims.objects import App, AppSpec, Claim, Component, DeviceRequirement, Meta, Pod, TelemetryDevice
from robotapp_api.claims.release import Release
from robotapp_api.model.names import Reason

ME = app_holder(component="driver")
CAN = DeviceRequirement(name="bus", type="can")


def reported(device_id: str = "can-can0", kind: str = "can", **fields: object) -> TelemetryDevice:
    return TelemetryDevice(id=device_id, type=kind, **fields)  # type: ignore[arg-type]  # a factory


@pytest.mark.parametrize(
    ("claim", "take"),
    [
        (None, Take.CREATE),
        (device_claim(pod="pod-1"), Take.ADOPT),
        (device_claim(pod=""), Take.TAKE),
        (device_claim(phase="Draining"), Take.TAKE),
        (device_claim(phase="Draining", pod="pod-1"), Take.TAKE),
        (device_claim(pod="pod-0"), Take.BUSY),
        (device_claim(holder=app_holder("app-2", component="driver"), phase="Draining"), Take.BUSY),
        (device_claim(holder=app_holder(component="camera"), phase="Draining"), Take.BUSY),
        (device_claim(holder=app_holder(component="driver", instance="amr-1"), phase="Draining"), Take.BUSY),
    ],
)
def test_only_the_same_app_instance_and_component_may_take_a_device_over(claim: Claim | None, take: Take) -> None:
    assert take_device(claim, holder=ME, pod_uid="pod-1") is take


GRANT = {"granted.robotics.io/devices": "can-can0"}


@pytest.mark.parametrize(
    ("claim", "found", "use"),
    [
        (device_claim(pod=""), None, PodUse.NONE),
        (device_claim(phase="Draining"), None, PodUse.NONE),
        (device_claim(pod="pod-1"), None, PodUse.GONE),
        (device_claim(pod="pod-1"), pod(uid="pod-2"), PodUse.GONE),
        (device_claim(pod="pod-1"), pod(phase="Failed"), PodUse.GONE),
        (device_claim(pod="pod-1"), pod(), PodUse.USES),
        (device_claim(pod="pod-1"), pod(node="edge-1", annotations=GRANT), PodUse.USES),
        (device_claim(pod="pod-1"), pod(node="edge-2", annotations=GRANT), PodUse.ELSEWHERE),
        (device_claim(pod="pod-1"), pod(node="edge-1"), PodUse.ELSEWHERE),
    ],
)
def test_what_the_named_pod_does_with_the_device(claim: Claim, found: Pod | None, use: PodUse) -> None:
    assert device.pod_use(claim, found) is use


@pytest.mark.parametrize(("use", "wanted", "over"), list(itertools.product(PodUse, [True, False], [True, False])))
def test_a_device_in_use_is_never_freed_and_a_wanted_one_waits_for_a_successor(
    use: PodUse, wanted: bool, over: bool
) -> None:
    decision = release_device(use=use, wanted=wanted, handed_over=over)
    if use is PodUse.USES:
        assert decision is Release.KEEP
    elif use is PodUse.ELSEWHERE or not wanted:
        assert decision is Release.DELETE
    elif use is PodUse.GONE:
        assert decision is Release.DRAIN
    else:
        assert decision is (Release.DELETE if over else Release.WAIT)


def app(*, suspend: bool = False, name: str = "driver", replicas: int = 1, exclusive: bool = True) -> App:
    part = Component(
        name=name, replicas=replicas, devices=(DeviceRequirement(name="bus", type="can", exclusive=exclusive),)
    )
    return App(metadata=Meta(uid="app-1"), spec=AppSpec(suspend=suspend, components=(part,)))


@pytest.mark.parametrize(
    ("found", "wanted"),
    [
        (app(), True),
        (None, False),
        (app(suspend=True), False),
        (app(name="camera"), False),
        (app(replicas=0), False),
        (app(exclusive=False), False),
    ],
)
def test_an_app_wants_devices_while_it_runs_and_its_component_asks(found: App | None, wanted: bool) -> None:
    assert device.wants_devices(found, ME) is wanted


def test_another_uid_wants_nothing_of_the_old_ones_devices() -> None:
    assert not device.wants_devices(app(), app_holder("app-0", component="driver"))


@pytest.mark.parametrize(
    ("match", "identity", "fits"),
    [
        ("8086:0b3a", "usb:8086:0B3A:123", True),
        ("8086:0B3A", "8086:0b3a", True),
        ("8086:0b3a:123", "usb:8086:0b3a:123", True),
        ("8086:0b3a:123", "usb:8086:0b3a:124", False),
        ("8086:0b3a:123", "usb:8086:0b3a", False),
        ("8086:0b3b", "usb:8086:0b3a:123", False),
        ("8086:0b3a:123", "usb:8086:0b3a:", False),
        ("8086:0b3a", "usb:8086:0b3a:", True),
        ("8086:0b3a:a1", "8086:0b3a:A1", False),
        ("8086:0b3a:a:1", "usb:8086:0b3a:a:1", True),
        ("usb:8086:0b3a", "8086:0b3a:123", True),
        ("8086:0b3a", "", False),
        ("serial-7", "serial-7", True),
        ("serial-7", "Serial-7", False),
        ("serial-7", "usb:serial-7", False),
    ],
)
def test_usb_identities_match_by_vendor_product_and_serial_others_as_they_are(
    match: str, identity: str, fits: bool
) -> None:
    assert device.identity_fits(match, identity) is fits


@pytest.mark.parametrize(
    ("requirement", "fits"),
    [
        (DeviceRequirement(type="usb"), True),
        (DeviceRequirement(type="can"), False),
        (DeviceRequirement(type="usb", model="d435"), True),
        (DeviceRequirement(type="usb", model="zed"), False),
        (DeviceRequirement(type="usb", interface="video0"), True),
        (DeviceRequirement(type="usb", interface="video1"), False),
        (DeviceRequirement(type="usb", match="8086:0b3a"), True),
    ],
)
def test_a_device_fits_by_everything_the_requirement_names(requirement: DeviceRequirement, fits: bool) -> None:
    camera = reported("cam", "usb", model="d435", interface="video0", identity="usb:8086:0b3a:1")
    assert device.fits(requirement, camera) is fits
    unplugged = reported("cam", "usb", model="d435", interface="video0", identity="usb:8086:0b3a:1", present=False)
    assert not device.fits(requirement, unplugged)


def choose(
    wanted: list[DeviceRequirement], devices: list[TelemetryDevice], *claims: Claim, pod_uid: str = "pod-1"
) -> device.Choice:
    return choose_devices(
        wanted, devices, {claim.name: claim for claim in claims}, node="edge-1", holder=ME, pod_uid=pod_uid
    )


def test_a_pod_gets_back_what_it_has_then_what_its_predecessor_left_then_something_free() -> None:
    devices = [reported("can-a"), reported("can-b"), reported("can-c")]
    left, mine = device_claim("can-c", phase="Draining"), device_claim("can-b", pod="pod-1")
    assert [d.id for d in choose([CAN], devices).devices] == ["can-a"]
    assert [d.id for d in choose([CAN], devices, left).devices] == ["can-c"]
    assert [d.id for d in choose([CAN], devices, left, mine).devices] == ["can-b"]


def test_a_device_that_somebody_has_is_busy_and_says_who() -> None:
    choice = choose([CAN], [reported()], device_claim(holder=app_holder("app-2", name="other", component="driver")))
    assert not choice.ok
    assert choice.reason == Reason.DEVICE_BUSY
    assert "can-can0 on edge-1 is held by team/other" in choice.message


def test_a_node_without_the_device_says_what_is_missing() -> None:
    choice = choose([DeviceRequirement(name="cam", type="usb", match="8086:0b3a")], [reported()])
    assert choice.reason == Reason.WAITING_FOR_DEVICES
    assert choice.message == "no usb 8086:0b3a device on edge-1"


def test_two_requirements_never_share_one_device_even_when_the_greedy_order_fails() -> None:
    first = DeviceRequirement(name="any", type="can")
    second = DeviceRequirement(name="zero", type="can", interface="can0")
    devices = [reported("can-a", interface="can0"), reported("can-b", interface="can1")]
    choice = choose([first, second], devices)
    assert {d.requirement: d.id for d in choice.devices} == {"any": "can-b", "zero": "can-a"}
    short = choose([first, second], devices[:1])
    assert not short.ok
    assert "not enough free devices" in short.message


def test_a_shared_device_is_looked_for_but_not_claimed() -> None:
    shared = DeviceRequirement(name="clock", type="can", exclusive=False)
    taken = device_claim(holder=app_holder("app-2", component="driver"))
    assert choose([shared], [reported()], taken) == device.Choice(True)
    assert not choose([shared], []).ok


kinds = st.sampled_from(["can", "usb"])


@given(
    st.lists(st.builds(lambda k, n: DeviceRequirement(name=n, type=k), kinds, st.sampled_from("abc")), max_size=4),
    st.lists(st.tuples(kinds, st.integers(0, 5)), max_size=6, unique_by=lambda pair: pair[1]),
    st.sets(st.integers(0, 5)),
)
def test_a_choice_is_complete_without_doubles_sorted_and_free(
    wanted: list[DeviceRequirement], found: list[tuple[str, int]], taken: set[int]
) -> None:
    devices = [reported(f"d{number}", kind) for kind, number in found]
    claims = [device_claim(f"d{number}", app_holder("app-2", component="driver")) for number in taken]
    choice = choose(wanted, devices, *claims)
    enough = all(
        sum(kind == one and number not in taken for one, number in found) >= sum(r.type == kind for r in wanted)
        for kind in ("can", "usb")
    )
    assert choice.ok is enough
    names = [one.claim for one in choice.devices]
    assert names == sorted(set(names))
    assert len(names) == (len(wanted) if enough else 0)
    assert not set(names) & {claim_name_device("edge-1", f"d{number}") for number in taken}
