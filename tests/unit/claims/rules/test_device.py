import itertools

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims.objects import app_holder, device_claim, pod

from robotapp_claims.rules import device
from robotapp_claims.rules.device import PREFERENCE, PodUse, Take, assign, busy_text, release_device, take_device
from robotapp_claims.rules.objects import App, AppSpec, Claim, Component, DeviceRequirement, Meta, Pod, TelemetryDevice
from robotapp_claims.rules.release import Release

ME = app_holder(component="driver")


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


def app(*, suspend: bool = False, name: str = "driver", replicas: int = 1, sharing: str = "Exclusive") -> App:
    part = Component(
        name=name, replicas=replicas, devices=(DeviceRequirement(name="bus", type="can", sharing=sharing),)
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
        (app(sharing="Namespace"), False),
        (app(sharing="Cluster"), False),
    ],
)
def test_an_app_wants_devices_while_it_runs_and_its_component_asks(found: App | None, wanted: bool) -> None:
    assert device.wants_devices(found, ME) is wanted


def test_a_device_is_exclusive_unless_its_sharing_says_otherwise_and_keeps_its_usb_id_on_the_wire() -> None:
    found = msgspec.json.decode(b'{"name": "cam", "type": "usb", "usbID": "8086:0b3a"}', type=DeviceRequirement)
    assert found == DeviceRequirement(name="cam", type="usb", usb_id="8086:0b3a", count=1, sharing="Exclusive")
    sharings = ("Exclusive", "Namespace", "Cluster")
    assert [device.claimed(DeviceRequirement(sharing=value)) for value in sharings] == [True, False, False]


def test_a_gpu_is_never_claimed_because_its_device_plugin_hands_it_out() -> None:
    gpu, camera = DeviceRequirement(type="gpu"), DeviceRequirement(type="usb", count=2)
    assert not device.claimed(gpu)
    assert device.claims_wanted([gpu]) == 0
    assert device.claims_wanted([gpu, camera, DeviceRequirement(type="can", sharing="Cluster")]) == 2


def test_another_uid_wants_nothing_of_the_old_ones_devices() -> None:
    assert not device.wants_devices(app(), app_holder("app-0", component="driver"))


@pytest.mark.parametrize(
    ("usb_id", "identity", "fits"),
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
        ("0x8086:0x0b3a", "8086:0b3a:123", True),
        ("0X8086:0b3a:0x1", "8086:0b3a:0x1", True),
        ("8086:0b3a:0x1", "8086:0b3a:1", False),
        ("serial-7", "serial-7", True),
        ("serial-7", "Serial-7", False),
        ("serial-7", "usb:serial-7", False),
    ],
)
def test_usb_identities_match_by_vendor_product_and_serial_others_as_they_are(
    usb_id: str, identity: str, fits: bool
) -> None:
    assert device.identity_fits(usb_id, identity) is fits


@pytest.mark.parametrize(
    ("requirement", "fits"),
    [
        (DeviceRequirement(type="usb"), True),
        (DeviceRequirement(type="can"), False),
        (DeviceRequirement(type="usb", model="d435"), True),
        (DeviceRequirement(type="usb", model="zed"), False),
        (DeviceRequirement(type="usb", interface="video0"), True),
        (DeviceRequirement(type="usb", interface="video1"), False),
        (DeviceRequirement(type="usb", usb_id="8086:0b3a"), True),
    ],
)
def test_a_device_fits_by_everything_the_requirement_names(requirement: DeviceRequirement, fits: bool) -> None:
    camera = reported("cam", "usb", model="d435", interface="video0", identity="usb:8086:0b3a:1")
    assert device.fits(requirement, camera) is fits
    unplugged = reported("cam", "usb", model="d435", interface="video0", identity="usb:8086:0b3a:1", present=False)
    assert not device.fits(requirement, unplugged)


@pytest.mark.parametrize(
    ("requirement", "found"),
    [
        (DeviceRequirement(type="camera"), "video"),
        (DeviceRequirement(type="webcam", model="Intel(R) RealSense 435i"), "video"),
        (DeviceRequirement(type="tty", usb_id="0x10C4:0xEA60"), "serial"),
        (DeviceRequirement(type="uart", interface="/dev/ttyTHS1"), "board"),
        (DeviceRequirement(type="can-bus", interface="can0"), "can"),
        (DeviceRequirement(type="usb", usb_id="8086:0b3a"), "video"),
        (DeviceRequirement(type="gripper", interface="/dev/hidraw0"), "gripper"),
        (DeviceRequirement(type="lidar"), ""),
        (DeviceRequirement(type="serial", interface="ttyUSB0"), ""),
    ],
)
def test_words_of_people_find_what_agents_publish(requirement: DeviceRequirement, found: str) -> None:
    node = [
        reported("video", "video", model="Intel-R-RealSense-435i", identity="8086:0b3a", names=("usb",)),
        reported("serial", "serial", model="CP2102", identity="10c4:ea60:7"),
        reported("board", "serial", interface="ttyTHS1"),
        reported("can", "can", interface="can0"),
        reported("gripper", "gripper", interface="/dev/hidraw0"),  # a rule may name anything
    ]
    assert [one.id for one in node if device.fits(requirement, one)] == ([found] if found else [])


# A device of its own for every wish

wishes = st.lists(st.frozensets(st.integers(0, 5)), max_size=5)
orders = st.lists(st.integers(0, 5), unique=True)


def everything(fitting: list[frozenset[int]], free: set[int]) -> list[tuple[int, ...]]:
    """Every way to give each wish a device of its own, by trying all."""
    found: list[tuple[int, ...]] = [()]
    for options in fitting:
        found = [(*rest, device) for rest in found for device in options & free if device not in rest]
    return found


@given(wishes, orders)
def test_every_wish_gets_a_device_of_its_own_whenever_that_is_possible_at_all(
    fitting: list[frozenset[int]], preferred: list[int]
) -> None:
    ways = everything(fitting, set(preferred))
    found = assign(fitting, preferred=preferred)
    assert (tuple(found) in ways) if found is not None else not ways


@given(wishes, orders)
def test_no_other_assignment_uses_better_devices(fitting: list[frozenset[int]], preferred: list[int]) -> None:
    rank = {device: index for index, device in enumerate(preferred)}
    found = assign(fitting, preferred=preferred)
    if found is not None:
        used = sorted(rank[device] for device in found)
        for way in everything(fitting, set(preferred)):
            assert all(mine <= theirs for mine, theirs in zip(used, sorted(map(rank.__getitem__, way)), strict=True))


def test_a_pod_gets_back_what_it_has_then_what_its_predecessor_left_then_something_free() -> None:
    takes = [
        take_device(claim, holder=ME, pod_uid="pod-1")
        for claim in (None, device_claim(phase="Draining"), device_claim(pod="pod-1"))
    ]
    assert sorted(takes, key=PREFERENCE.__getitem__) == [Take.ADOPT, Take.TAKE, Take.CREATE]


def test_a_busy_device_says_who_has_it_and_when_it_is_free() -> None:
    taken = device_claim(holder=app_holder("app-2", name="other", component="driver"))
    text = busy_text(taken, for_namespace="team")
    assert text == "device can-can0 on edge-1 is held by team/other: it is free when its holder is deleted or suspended"


@pytest.mark.parametrize(
    ("component", "replicas", "wanted"),
    [("driver-1", 2, True), ("driver-2", 2, False), ("driver", 2, False), ("driver-0", 0, False)],
)
def test_a_replica_with_an_ordinal_wants_devices_of_its_own_while_there_is_one_of_its_number(
    component: str, replicas: int, wanted: bool
) -> None:
    part = {
        "name": "driver",
        "replicas": replicas,
        "replicaIdentity": "Ordinal",
        "devices": [{"name": "c", "type": "usb"}],
    }
    written = msgspec.convert({"metadata": {"uid": "app-1"}, "spec": {"components": [part]}}, App)
    holder = app_holder("app-1", component=component)
    assert device.wants_devices(written, holder) is wanted
