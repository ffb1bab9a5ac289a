"""From an allocated claim to devices, or to a reason with its cure."""

from typing import Any

import msgspec
import pytest
from tests.support.agent.dra import ADAPTER, BOOT, NODE, can_bus, claim, config, device, result

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.rules.allocation import ResourceClaim, plan_preparation
from robotapp_agent.driver.rules.ledger import PreparedClaim
from robotapp_agent.driver.rules.refusal import Refusal
from robotapp_api.model.patterns import is_device_path

OTHER = "serial-10c4-ea60-7"


def plan(body: dict[str, Any], *devices: Device, uid: str = "uid-of-driver") -> PreparedClaim | Refusal:
    decoded = msgspec.json.decode(msgspec.json.encode(body), type=ResourceClaim)
    here = {one.id: one for one in devices or (device(), device(OTHER, path="/dev/ttyUSB1"), can_bus())}
    return plan_preparation(decoded, uid=uid, node=NODE, devices=here, boot_id=BOOT)


def refused(*args: Any, **kwargs: Any) -> str:
    planned = plan(*args, **kwargs)
    assert isinstance(planned, Refusal)
    return planned.text


def planned(*args: Any, **kwargs: Any) -> PreparedClaim:
    claim_to_prepare = plan(*args, **kwargs)
    assert isinstance(claim_to_prepare, PreparedClaim)
    return claim_to_prepare


def test_without_configuration_the_variable_is_named_after_the_request() -> None:
    (one,) = planned(claim("driver", result("front-lidar"))).devices
    assert (one.variable, one.mount_as) == ("ROBOTAPP_DEVICE_FRONT_LIDAR", "")


def test_a_configuration_counts_for_its_requests_and_later_ones_win() -> None:
    body = claim(
        "driver",
        result("lidar"),
        result("arm", OTHER),
        configs=[
            config(env="ANY", mountAs="/dev/any-lidar"),
            config(["arm"], env="ARM", mountAs="/dev/arm"),
            config(["lidar"], driver="gpu.example.org", nonsense=True),
        ],
    )
    lidar, arm = planned(body).devices
    assert (lidar.variable, lidar.mount_as) == ("ROBOTAPP_DEVICE_ANY", "/dev/any-lidar")
    assert (arm.variable, arm.mount_as) == ("ROBOTAPP_DEVICE_ARM", "/dev/arm")


def test_the_configuration_of_a_request_counts_for_the_chosen_alternative() -> None:
    body = claim("driver", result("lidar/cheap"), configs=[config(["lidar"], mountAs="/dev/lidar")])
    assert planned(body).devices[0].mount_as == "/dev/lidar"


@pytest.mark.parametrize("path", ["/dev/serial/by-id/usb-FTDI_A5:1.0-if00@x+y", "/dev/a/b/c/d/e/f/g/h/i/j"])
def test_a_path_that_the_api_of_robotapps_takes_is_a_path_of_a_device(path: str) -> None:
    assert is_device_path(path)
    assert planned(claim("driver", configs=[config(mountAs=path)])).devices[0].mount_as == path


def test_devices_of_other_drivers_in_the_same_claim_are_left_to_them() -> None:
    gpu = {**result("gpu", "gpu-0"), "driver": "gpu.example.org"}
    assert [one.device for one in planned(claim("driver", gpu, result())).devices] == [ADAPTER]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"mountAs": "/etc/passwd"}, "mountAs"),
        ({"mountAs": "/dev/../etc/passwd"}, "mountAs"),
        ({"mountAs": "/dev/null"}, "every container has"),
        ({"mountAs": "/dev/pts/0"}, "every container has"),
        ({"mountAs": "/dev"}, "mountAs"),
        ({"mountAs": "/dev/lidar/../../etc/passwd"}, "mountAs"),
        ({"mountAs": "/dev//lidar"}, "mountAs"),
        ({"mountAs": "/dev/lidar/"}, "mountAs"),
        ({"mountAs": "/dev/lidar\n"}, "mountAs"),
        ({"mountAs": "/dev/l\u0131dar"}, "mountAs"),
        ({"mountAs": "/dev/stdin/x"}, "every container has"),
        ({"env": "LIDAR\n"}, "env"),
        ({"env": "LD=/dev/x"}, "env"),
        ({"env": "lower"}, "env"),
        ({"network": "Pod"}, "network"),
        ({"path": "/dev/lidar"}, "path"),
        ({"kind": "GpuConfig"}, "kind"),
        ({"apiVersion": "v2"}, "apiVersion"),
    ],
)
def test_a_wrong_configuration_is_refused_with_the_field(fields: dict[str, str], words: str) -> None:
    text = refused(claim("driver", configs=[config(**fields)]))
    assert words in text
    assert "request lidar" in text


def test_a_claim_that_was_replaced_is_not_prepared() -> None:
    assert "replaced" in refused(claim(), uid="uid-of-its-predecessor")


def test_a_claim_without_allocation_is_not_prepared() -> None:
    assert refused({**claim(), "status": {}}) == "claim fleet/driver is not allocated any more"


def test_a_device_that_is_not_there_is_named_with_the_node() -> None:
    assert "node robot-1 has no device serial-9" in refused(claim("driver", result(device_id="serial-9")))


def test_an_unplugged_device_is_not_prepared() -> None:
    assert refused(claim(), device(present=False)) == f"device {ADAPTER} of node robot-1 is not plugged in"


def test_a_device_of_another_pool_is_not_prepared() -> None:
    assert "this is node robot-1" in refused(claim("driver", result(pool="robot-2")))


def test_a_network_interface_is_refused_with_the_cure() -> None:
    text = refused(claim("driver", result("bus", "can-can0")))
    assert "hostNetwork: true" in text
    assert "network: Host" in text


def test_a_pod_in_the_network_of_the_node_gets_the_name_of_the_interface() -> None:
    body = claim("driver", result("bus", "can-can0"), configs=[config(["bus"], network="Host")])
    assert planned(body).devices[0].device == "can-can0"


def test_a_network_interface_has_no_path_to_mount() -> None:
    body = claim("driver", result("bus", "can-can0"), configs=[config(network="Host", mountAs="/dev/can")])
    assert "leave mountAs out" in refused(body)


def test_one_path_is_not_given_to_several_devices() -> None:
    same_request = claim("driver", result(), result(device_id=OTHER), configs=[config(mountAs="/dev/lidar")])
    assert "several devices" in refused(same_request)
    two_requests = claim(
        "driver", result(), result("arm", OTHER), configs=[config(["lidar", "arm"], mountAs="/dev/lidar")]
    )
    assert "two devices" in refused(two_requests)
    other_path = claim("driver", result(), result("arm", OTHER), configs=[config(["lidar"], mountAs="/dev/ttyUSB1")])
    assert "two devices of claim fleet/driver have path /dev/ttyUSB1" in refused(other_path), "the arm is there already"
    below = claim(
        "driver",
        result(),
        result("arm", OTHER),
        configs=[config(["lidar"], mountAs="/dev/arm"), config(["arm"], mountAs="/dev/arm/joint")],
    )
    assert "mountAs /dev/arm/joint of claim fleet/driver lies below the device /dev/arm" in refused(below)


def test_an_allocation_by_hand_that_names_a_device_twice_is_refused() -> None:
    assert f"device {ADAPTER} is allocated 2 times to request lidar" in refused(claim("driver", result(), result()))


def test_a_device_without_file_is_refused() -> None:
    assert "no device file" in refused(claim(), device(path=""))
