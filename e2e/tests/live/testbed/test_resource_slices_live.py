"""Simulated nodes publish their devices in the driver's own form, and the API server takes it."""

from collections.abc import Iterator
from typing import Any

import pytest

from robotapp_testbed import ControlPlane
from robotapp_testbed.machines import resource_slices, topology
from robotapp_testbed.machines.fleet_file import topology_of

pytestmark = pytest.mark.live

ARM = "serial-0403-6001-a50285bi"
FLEET = topology_of(
    {
        "robots": [
            {
                "name": "sliced-robot",
                "devices": [{"type": "serial", "identity": "0403:6001:A50285BI"}, {"type": "can", "interface": "can0"}],
            },
            {"name": "bare-robot"},
        ]
    }
)


@pytest.fixture(scope="module")
def plane(control_plane: ControlPlane) -> Iterator[ControlPlane]:
    topology.apply(control_plane, FLEET)
    resource_slices.publish(control_plane, FLEET)
    yield control_plane
    control_plane.kubectl("delete", "resourceslices,deviceclasses", "--all")
    topology.remove(control_plane, FLEET)


def published(plane: ControlPlane, node: str) -> dict[str, Any]:
    (one,) = plane.api.get(f"{resource_slices.SLICES}?fieldSelector=spec.nodeName={node}")["items"]
    return {device["name"]: device for device in one["spec"].get("devices") or ()}


def test_devices_of_a_fleet_file_are_published_with_the_names_that_agents_give(plane: ControlPlane) -> None:
    devices = published(plane, "sliced-robot")
    assert set(devices) == {ARM, "can-can0"}
    assert devices[ARM]["attributes"]["name_usb"] == {"bool": True}
    assert devices["can-can0"]["attributes"]["interface"] == {"string": "can0"}
    assert published(plane, "bare-robot") == {}


def test_a_lost_device_has_a_taint_until_it_is_back(plane: ControlPlane) -> None:
    resource_slices.publish(plane, FLEET, unplugged={"sliced-robot": [ARM]})
    (taint,) = published(plane, "sliced-robot")[ARM]["taints"]
    assert (taint["key"], taint["effect"]) == ("devices.robotics.io/lost", "NoSchedule")
    resource_slices.publish(plane, FLEET)
    assert "taints" not in published(plane, "sliced-robot")[ARM]
