"""One device has one identity: whoever begins or ceases to describe a node never makes a held device free."""

from collections.abc import Callable

import msgspec
import pytest
from tests.support.scheduling import device_claim, make_cluster, make_node, telemetry

from robotapp_claims.rules.node_devices import Device
from robotapp_claims.rules.objects import Claim, DeviceThing, TelemetryDevice
from robotapp_scheduler.core.api.ros import DeviceHolder, DeviceRequest
from robotapp_scheduler.core.robotics.device_index import DeviceGrant, DeviceIndex

CAMERAS = (("cam0", "111"), ("cam1", "222"))
"""Interface and serial of the two cameras that are really there."""
CAMERA = DeviceRequest("cam", "usb")
MINE = DeviceHolder(uid="app-1", namespace="default", component="driver", pod_uid="mine")
SUCCESSOR = DeviceHolder(uid="app-1", namespace="default", component="driver", pod_uid="successor")
OTHER = DeviceHolder(uid="app-2", namespace="default", component="driver", pod_uid="other")
PREFIX = "hardware.robotics.io/"


def bare_label(devices: DeviceIndex) -> None:
    devices.drop_telemetry("n", {f"{PREFIX}usb": "d435"})


def label_per_interface(devices: DeviceIndex) -> None:
    devices.drop_telemetry("n", {f"{PREFIX}usb-{interface}": "true" for interface, _ in CAMERAS})


def both_labels(devices: DeviceIndex) -> None:
    devices.drop_telemetry("n", {f"{PREFIX}usb": "true", f"{PREFIX}usb-cam0": "true"})


def agent(*, interfaces: bool, identities: bool = True) -> Callable[[DeviceIndex], None]:
    def describe(devices: DeviceIndex) -> None:
        found = (
            TelemetryDevice(
                id=f"usb-{serial if identities else interface}",
                type="usb",
                interface=interface if interfaces else "",
                identity=f"8086:0b3a:{serial}" if identities else "",
            )
            for interface, serial in CAMERAS
        )
        devices.set_telemetry("n", found)

    return describe


def agent_with_names(devices: DeviceIndex) -> None:
    """An agent that reports cameras as such, and knows that they are asked for as usb as well."""
    found = (
        TelemetryDevice(
            id=f"video-8086-0b3a-{serial}",
            type="video",
            identity=f"8086:0b3a:{serial}",
            names=("usb", f"usb-{interface}"),
        )
        for interface, serial in CAMERAS
    )
    devices.set_telemetry("n", found)


DESCRIPTIONS = {
    "bare label": bare_label,
    "label per interface": label_per_interface,
    "both labels": both_labels,
    "agent with interfaces": agent(interfaces=True),
    "agent without interfaces": agent(interfaces=False),
    "agent without identities": agent(interfaces=True, identities=False),
    "agent with names": agent_with_names,
}


def cameras_of(device: Device) -> set[int]:
    """The cameras it may be."""
    return {
        number
        for number, (interface, serial) in enumerate(CAMERAS)
        if device.id == "usb" or interface in (device.interface, device.id.removeprefix("usb-")) or serial in device.id
    }


def claim_of(grant: DeviceGrant, holder: DeviceHolder, *, phase: str = "Reserved") -> Claim:
    found = device_claim(
        "n", grant.device.id, uid=holder.uid, component=holder.component, pod=holder.pod_uid, phase=phase
    )
    thing = DeviceThing(node="n", type=grant.device.type, id=grant.device.id, identity=grant.device.identity)
    return msgspec.structs.replace(found, spec=msgspec.structs.replace(found.spec, device=thing))


@pytest.mark.parametrize("after", DESCRIPTIONS)
@pytest.mark.parametrize("before", DESCRIPTIONS)
def test_a_held_device_stays_held_whoever_describes_the_node_next(before: str, after: str) -> None:
    for promised in (True, False):
        devices = DeviceIndex()
        DESCRIPTIONS[before](devices)
        (mine,) = devices.choose((CAMERA,), "n", MINE) or ()
        if promised:
            devices.assume(MINE.pod_uid, (mine,))
        else:
            devices.apply_claim(claim_of(mine, MINE))
        for describe in (DESCRIPTIONS[after], DESCRIPTIONS[before], DESCRIPTIONS[after]):
            describe(devices)
            for grant in devices.choose((CAMERA,), "n", OTHER) or ():
                assert not cameras_of(mine.device) & cameras_of(grant.device), (mine, grant)


@pytest.mark.parametrize("after", DESCRIPTIONS)
@pytest.mark.parametrize("before", DESCRIPTIONS)
def test_a_restarted_pod_gets_its_device_back_under_the_name_it_was_held_under(before: str, after: str) -> None:
    devices = DeviceIndex()
    DESCRIPTIONS[before](devices)
    (mine,) = devices.choose((CAMERA,), "n", MINE) or ()
    devices.apply_claim(claim_of(mine, MINE, phase="Draining"))
    DESCRIPTIONS[after](devices)
    (again,) = devices.choose((CAMERA,), "n", SUCCESSOR) or ()
    assert again.device.id == mine.device.id


def test_a_camera_that_is_unplugged_does_not_keep_the_other_one_from_people() -> None:
    devices = DeviceIndex()
    DESCRIPTIONS["agent with interfaces"](devices)
    (mine,) = devices.choose((CAMERA,), "n", MINE) or ()
    devices.apply_claim(claim_of(mine, MINE))
    left = [device for device in devices.of("n") if device.id != mine.device.id]
    reports = [
        TelemetryDevice(id=device.id, type="usb", interface=device.interface, identity=device.identity)
        for device in left
    ]
    unplugged = TelemetryDevice(id=mine.device.id, type="usb", identity=mine.device.identity, present=False)
    for report in (reports, [*reports, unplugged]):
        devices.set_telemetry("n", report)
        (theirs,) = devices.choose((CAMERA,), "n", OTHER) or ()
        assert theirs.device.id == left[0].id


def test_a_bus_that_an_agent_no_longer_lists_leaves_the_other_bus_free() -> None:
    devices = DeviceIndex()
    buses = [TelemetryDevice(id=f"can-can{number}", type="can", interface=f"can{number}") for number in (0, 1)]
    devices.set_telemetry("n", buses)
    devices.apply_claim(device_claim("n", "can-can0", uid="app-1"))
    devices.set_telemetry("n", buses[1:])
    (grant,) = devices.choose((DeviceRequest("bus", "can"),), "n", OTHER) or ()
    assert grant.device.id == "can-can1"


def test_a_label_and_an_agent_that_use_one_name_mean_one_device() -> None:
    cluster = make_cluster(make_node("n", labels={f"{PREFIX}can-can0": "true"}))
    request = DeviceRequest("bus", "can")
    cluster.apply_claim(device_claim("n", "can-can0", uid="app-1"))
    report = telemetry("n", devices=[{"id": "can-can0", "type": "can", "interface": "can0"}])
    for change in (cluster.apply_telemetry, cluster.remove_telemetry, cluster.apply_telemetry):
        assert cluster.devices.choose((request,), "n", OTHER) is None
        change(report)
        assert cluster.devices.choose((request,), "n", OTHER) is None


def test_a_claim_that_was_made_again_for_a_running_pod_knows_no_type_and_holds_all_the_same() -> None:
    devices = DeviceIndex()
    DESCRIPTIONS["agent with interfaces"](devices)
    found = device_claim("n", "usb", uid="app-1")
    thing = DeviceThing(node="n", type="unknown", id="usb")
    devices.apply_claim(msgspec.structs.replace(found, spec=msgspec.structs.replace(found.spec, device=thing)))
    assert devices.choose((CAMERA,), "n", OTHER) is None


def test_a_device_is_found_by_each_of_its_names_and_claimed_under_its_id() -> None:
    devices = DeviceIndex()
    camera = TelemetryDevice(
        id="video-8086-0b3a-111", type="video", model="D435i", identity="8086:0b3a:111", names=("usb", "sensor-usb-cam")
    )
    devices.set_telemetry("n", [camera])
    asked = (
        DeviceRequest("cam", "video"),
        DeviceRequest("cam", "usb", usb_id="8086:0B3A"),
        DeviceRequest("cam", "sensor"),
        DeviceRequest("cam", "sensor", interface="usb-cam", model="D435i"),
    )
    for request in asked:
        (grant,) = devices.choose((request,), "n", MINE) or ()
        assert grant.device.id == camera.id
        assert devices.capable(request) == {"n"}
    devices.apply_claim(claim_of(grant, MINE))
    assert [devices.choose((request,), "n", OTHER) for request in asked] == [None] * len(asked)


def test_a_name_with_another_interface_is_another_name() -> None:
    devices = DeviceIndex()
    devices.set_telemetry("n", [TelemetryDevice(id="video-a", type="video", names=("sensor-usb-cam",))])
    for request in (
        DeviceRequest("cam", "sensor", interface="usb"),
        DeviceRequest("cam", "sens"),
        DeviceRequest("cam", "video", interface="usb-cam"),
        DeviceRequest("cam", "sensor", interface="usb-cam", model="D435i"),
    ):
        assert not devices.capable(request)


def test_labels_made_from_telemetry_are_no_devices_of_their_own() -> None:
    """One camera has several such labels: counted as devices it would be given to several pods."""
    devices = DeviceIndex()
    labels = {f"{PREFIX}{name}": "D435i" for name in ("video", "video-8086-0b3a-111", "sensor-usb-cam", "usb")}
    devices.set_labels("n", labels | {f"{PREFIX}source": "telemetry"})
    assert devices.of("n") == ()
    devices.set_labels("n", labels)
    assert len(devices.of("n")) == 3
