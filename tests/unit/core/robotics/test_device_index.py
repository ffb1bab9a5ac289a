import pytest
from tests.support.scheduling import device_claim, make_cluster, make_node, make_pod, telemetry

from robotapp_api.model.names import Annotation
from robotapp_claims.rules.device import fits_kind
from robotapp_claims.rules.identity import device_label
from robotapp_claims.rules.node_devices import Device, devices_of_labels
from robotapp_claims.rules.objects import TelemetryDevice
from robotapp_scheduler.core.api.ros import DeviceHolder, DeviceRequest
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.robotics import device_index
from robotapp_scheduler.core.robotics.device_index import DeviceGrant, DeviceIndex

MINE = DeviceHolder(uid="app-1", namespace="default", instance="amr", component="driver", pod_uid="new")
CAN = DeviceRequest("bus", "can")


def index(*devices: TelemetryDevice) -> DeviceIndex:
    found = DeviceIndex()
    found.set_telemetry("n", devices)
    return found


def can(number: int, **fields: str) -> TelemetryDevice:
    return TelemetryDevice(id=f"can-can{number}", type="can", interface=f"can{number}", **fields)


def test_a_request_is_met_by_the_rule_that_claims_use() -> None:
    devices = index(
        TelemetryDevice(id="cam", type="usb", model="d435", interface="video0", identity="usb:8086:0B3A:123")
    )
    fitting = ({}, {"model": "d435", "interface": "video0"}, {"usb_id": "8086:0b3a"}, {"usb_id": "usb:8086:0b3a:123"})
    others = ({"model": "zed"}, {"interface": "video1"}, {"usb_id": "8086:0b3b"}, {"usb_id": "8086:0b3a:124"})
    assert [devices.capable(DeviceRequest("cam", "usb", **fields)) for fields in fitting] == [{"n"}] * 4
    assert [devices.capable(DeviceRequest("cam", "usb", **fields)) for fields in others] == [set()] * 4
    assert devices.capable(DeviceRequest("bus", "can")) == set()


def test_labels_say_what_a_node_has_until_an_agent_does() -> None:
    labels = {"hardware.robotics.io/can-can0": "true", "hardware.robotics.io/gpu": "nvidia", "zone": "a"}
    assert devices_of_labels(labels) == (Device("can-can0", "can", "", "can0"), Device("gpu", "gpu", "nvidia", ""))
    cluster = make_cluster(make_node("n", labels=labels))
    assert [device.id for device in cluster.devices.of("n")] == ["can-can0", "gpu"]
    assert cluster.apply_telemetry(telemetry("n", devices=[{"id": "usb-1", "type": "usb"}])) & Change.DEVICES
    assert [device.id for device in cluster.devices.of("n")] == ["usb-1"]
    assert cluster.remove_telemetry(telemetry("n")) & Change.DEVICES
    assert [device.id for device in cluster.devices.of("n")] == ["can-can0", "gpu"]


def test_a_label_of_the_type_alone_is_no_second_device_beside_one_that_names_it() -> None:
    usb = "hardware.robotics.io/usb"
    assert devices_of_labels({usb: "d435"}) == (Device("usb", "usb", "d435"),)
    assert devices_of_labels({usb: "d435", f"{usb}-cam0": "true"}) == (Device("usb-cam0", "usb", "d435", "cam0"),)
    two = {usb: "d435", f"{usb}-cam0": "true", f"{usb}-cam1": "zed"}
    assert [(device.id, device.model) for device in devices_of_labels(two)] == [("usb-cam0", ""), ("usb-cam1", "zed")]


def test_an_absent_device_does_not_count() -> None:
    assert index(TelemetryDevice(id="x", type="can", present=False)).of("n") == ()


@pytest.mark.parametrize(("exclusive", "most"), [(True, 0), (False, 16 * 4)])
def test_of_256_requests_for_16_kinds_each_kind_is_compared_with_a_node_once_or_never(
    monkeypatch: pytest.MonkeyPatch, exclusive: bool, most: int
) -> None:
    """One app of 64 components asked for so many, on every node, between two other pods."""
    devices, calls = index(*(can(number) for number in range(4))), list[DeviceRequest]()

    def counting(request: DeviceRequest, device: Device) -> bool:
        calls.append(request)
        return fits_kind(request, device)

    monkeypatch.setattr(device_index, "fits_kind", counting)
    requests = [DeviceRequest(f"d{kind}", "can", exclusive=exclusive) for kind in range(16) for _ in range(16)]
    assert devices.choose(requests, "n", MINE) is None
    assert len(calls) <= most


def test_two_requests_get_two_devices_even_when_the_first_would_take_the_only_match_of_the_second() -> None:
    devices = index(can(0), can(1))
    requests = (DeviceRequest("any", "can"), DeviceRequest("front", "can", interface="can0"))
    grants = devices.choose(requests, "n", MINE)
    assert grants is not None
    assert [(grant.request, grant.device.id) for grant in grants] == [("any", "can-can1"), ("front", "can-can0")]
    assert devices.choose((*requests, DeviceRequest("third", "can")), "n", MINE) is None


TAP = DeviceRequest("tap", "can", exclusive=False)
STRANGER = DeviceHolder(uid="app-2", namespace="other", pod_uid="stranger")


def test_a_shared_request_does_not_enter_a_device_that_is_held_alone() -> None:
    devices = index(can(0))
    devices.apply_claim(device_claim("n", "can-can0", uid="stranger"))
    assert devices.choose((TAP,), "n", MINE) is None
    (busy,) = devices.blockers((TAP,), "n", MINE)
    assert busy.holder == "other"
    devices.remove_claim("dev.n.can-can0")
    grants = devices.choose((TAP,), "n", MINE)
    assert grants is not None
    assert not grants[0].exclusive


def test_a_shared_request_does_not_enter_a_device_that_was_promised_to_one_pod() -> None:
    devices = index(can(0))
    devices.assume("stranger", devices.choose((CAN,), "n", STRANGER) or ())
    assert devices.choose((TAP,), "n", MINE) is None


def test_an_exclusive_request_does_not_enter_a_device_that_others_share_and_gets_it_when_the_last_one_goes() -> None:
    devices = index(can(0))
    for uid in ("one", "two"):
        sharer = DeviceHolder(uid=uid, namespace="default", pod_uid=uid)
        devices.assume(uid, devices.choose((TAP,), "n", sharer) or (), namespace="default", name=uid)
    assert devices.choose((CAN,), "n", MINE) is None
    assert [(busy.namespace, busy.holder) for busy in devices.blockers((CAN,), "n", MINE)] == [("default", "one")]
    devices.release("one")
    assert devices.choose((CAN,), "n", MINE) is None
    devices.release("two")
    assert devices.choose((CAN,), "n", MINE) is not None
    assert not devices.contested("n")


def test_a_pod_that_shared_a_device_before_this_process_began_keeps_it_from_others_by_its_grant() -> None:
    shared = {str(Annotation.GRANTED_SHARED): "can-can0"}
    cluster = make_cluster(make_node("n", labels={"hardware.robotics.io/can-can0": "true"}))
    sharer = make_pod("sharer", node="n", annotations=shared)
    cluster.apply_pod(sharer)
    assert cluster.devices.choose((CAN,), "n", MINE) is None
    assert cluster.devices.choose((TAP,), "n", MINE) is not None
    cluster.remove_pod(sharer)
    assert cluster.devices.choose((CAN,), "n", MINE) is not None


def test_sharers_come_together_and_a_pods_own_exclusive_request_leaves_it_the_device_to_share() -> None:
    devices = index(can(0), can(1))
    devices.assume("other", [DeviceGrant("tap", "n", devices.of("n")[1], exclusive=False)], namespace="a", name="x")
    (grant,) = devices.choose((TAP,), "n", MINE) or ()
    assert grant.device.id == "can-can1"
    front = DeviceRequest("front", "can", interface="can0", exclusive=False)
    both = index(can(0), can(1)).choose((CAN, front), "n", MINE)
    assert both is not None
    assert [grant.device.id for grant in both] == ["can-can1", "can-can0"]
    assert index(can(0)).choose((CAN, front), "n", MINE) is None, "not the one it holds alone"


@pytest.mark.parametrize(
    ("phase", "pod", "component", "free"),
    [
        ("Reserved", "", "driver", True),
        ("Reserved", "new", "driver", True),
        ("Bound", "old", "driver", False),
        ("Draining", "old", "driver", True),
        ("Draining", "old", "planner", False),
        ("Reserved", "", "planner", False),
    ],
)
def test_a_claim_is_ours_for_the_same_app_instance_and_component_and_no_other_pod(
    phase: str, pod: str, component: str, free: bool
) -> None:
    devices = index(can(0))
    devices.apply_claim(
        device_claim("n", "can-can0", uid="app-1", instance="amr", component=component, phase=phase, pod=pod)
    )
    assert (devices.choose((CAN,), "n", MINE) is not None) is free
    assert bool(devices.blockers((CAN,), "n", MINE)) is not free


def test_a_retry_takes_the_device_it_has_claimed_already() -> None:
    devices = index(can(0), can(1))
    devices.apply_claim(
        device_claim("n", "can-can1", uid="app-1", instance="amr", component="driver", phase="Reserved")
    )
    grants = devices.choose((CAN,), "n", MINE)
    assert grants is not None
    assert grants[0].device.id == "can-can1"


def test_a_retry_keeps_all_it_has_claimed_whichever_request_each_device_meets() -> None:
    devices = index(
        TelemetryDevice(id="can-both", type="can", model="m", interface="x"),
        TelemetryDevice(id="can-fresh", type="can", model="m", interface="y"),
        TelemetryDevice(id="can-other", type="can", model="n", interface="x"),
    )
    for mine in ("can-both", "can-other"):
        devices.apply_claim(
            device_claim("n", mine, uid="app-1", instance="amr", component="driver", phase="Reserved", pod="new")
        )
    grants = devices.choose((DeviceRequest("m", "can", model="m"), DeviceRequest("x", "can", interface="x")), "n", MINE)
    assert grants is not None
    assert [grant.device.id for grant in grants] == ["can-both", "can-other"]


def test_a_promise_keeps_others_out_until_it_is_released() -> None:
    devices = index(can(0))
    grants = devices.choose((CAN,), "n", MINE)
    assert grants is not None
    devices.assume("new", grants)
    other = DeviceHolder(uid="app-2", namespace="default", pod_uid="other")
    assert devices.contested("n")
    assert devices.choose((CAN,), "n", other) is None
    assert devices.choose((CAN,), "n", MINE) is not None
    devices.release("new")
    assert not devices.contested("n")
    assert devices.choose((CAN,), "n", other) is not None


def test_the_holder_is_named_for_the_event() -> None:
    devices = index(can(0))
    devices.apply_claim(device_claim("n", "can-can0", uid="x", holder_name="teleop-b"))
    (busy,) = devices.blockers((CAN,), "n", MINE)
    assert (busy.device.id, busy.namespace, busy.holder) == ("can-can0", "default", "teleop-b")


def test_a_device_whose_id_is_no_dns_label_is_busy_under_the_label_its_claim_has() -> None:
    devices = index(TelemetryDevice(id="usb:1d50:606f:00A1", type="can"))
    devices.apply_claim(device_claim("n", device_label("usb:1d50:606f:00A1"), uid="stranger"))
    assert devices.choose((CAN,), "n", MINE) is None
    assert len(devices.blockers((CAN,), "n", MINE)) == 1


def test_promises_and_own_claims_of_such_a_device_are_found_again() -> None:
    first, second = (TelemetryDevice(id=f"usb:1d50:606f:0{name}", type="can") for name in "AB")
    devices = index(first, second)
    devices.apply_claim(
        device_claim(
            "n", device_label(second.id), uid="app-1", instance="amr", component="driver", phase="Reserved", pod="new"
        )
    )
    grants = devices.choose((CAN,), "n", MINE)
    assert grants is not None
    assert grants[0].device.id == second.id
    devices = index(second)
    devices.assume("new", grants)
    assert devices.choose((CAN,), "n", DeviceHolder(uid="app-2", namespace="default", pod_uid="other")) is None


def test_what_nobody_has_claimed_or_was_promised_is_counted_by_type() -> None:
    devices = index(can(0), can(1), can(2), TelemetryDevice(id="usb-1", type="usb"))
    assert devices.free_by_type() == {"can": 3, "usb": 1}
    devices.apply_claim(device_claim("n", "can-can0", uid="other"))
    devices.apply_claim(device_claim("n", "usb-1", uid="other"))
    assert devices.free_by_type() == {"can": 2, "usb": 0}
    devices.remove_claim("dev.n.usb-1")
    assert devices.free_by_type() == {"can": 2, "usb": 1}


def test_a_shared_entry_with_a_count_takes_as_many_different_devices_and_two_entries_may_share_one() -> None:
    devices = index(can(0), can(1))
    two = (DeviceRequest("bus", "can", exclusive=False),) * 2
    found = devices.choose(two, "n", MINE)
    assert found is not None
    assert {grant.device.id for grant in found} == {"can-can0", "can-can1"}
    assert index(can(0)).choose(two, "n", MINE) is None
    names = [DeviceRequest(name, "can", exclusive=False) for name in ("left", "right")]
    assert index(can(0)).choose(names, "n", MINE) is not None


def test_a_device_that_is_kept_for_another_pod_is_taken_when_there_is_no_other() -> None:
    devices = index(can(0), can(1))
    devices.keep({("n", "can-can0"): "other"})
    (grant,) = devices.choose((CAN,), "n", MINE) or ()
    assert grant.device.id == "can-can1"
    both = devices.choose((CAN, CAN), "n", MINE)
    assert both is not None
    devices.keep({("n", "can-can0"): MINE.pod_uid})
    (grant,) = devices.choose((CAN,), "n", MINE) or ()
    assert grant.device.id == "can-can0"
