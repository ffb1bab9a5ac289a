"""A device is unplugged below a container, and another one gets its device file."""

import os
from collections.abc import Iterator

import pytest
from tests.support.agent.dra import ADAPTER, device, result
from tests.support.agent.driver_node import ZERO, Node

from robotapp_agent.devices.device import Device


@pytest.fixture
def terminal() -> Iterator[str]:
    """A device file with a number of its own, which a test may make."""
    ours, theirs = os.openpty()
    yield os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize("without", [(), (device(path="/dev/zero", present=False),)], ids=["forgotten", "unplugged"])
async def test_a_container_that_restarts_without_its_device_gets_none_that_took_its_path(
    node: Node, without: tuple[Device, ...]
) -> None:
    node.allocate("driver")
    async with node.run() as plugin:
        await node.kubelet.prepare("driver")
        plugin.update_devices([*without, device("serial-9", path="/dev/zero")])
        assert node.cdi.list_uids() == []
        plugin.update_devices([ZERO])
    assert node.spec("driver")["devices"][0]["containerEdits"]["deviceNodes"][0]["hostPath"] == "/dev/zero"


async def test_a_device_that_took_the_path_of_a_lost_one_waits_for_the_container_that_lost_it(
    node: Node, terminal: str
) -> None:
    """It may be the very same: an adapter goes by its port as soon as another one with its serial is plugged in."""
    node.allocate("first")
    node.allocate("second", result(device_id="serial-new"))
    new = device("serial-new", path=terminal)
    async with node.run(devices=(device(path=terminal),)):
        await node.kubelet.prepare("first")
    async with node.run(devices=(device(path=terminal, present=False), new)):
        refusal = (await node.kubelet.prepare("second")).error
        assert f"serial-new of node robot-1 is in use by claim first for {ADAPTER}, which was unplugged" in refusal
        await node.kubelet.unprepare("first")
        assert (await node.kubelet.prepare("second")).error == ""


async def test_a_container_never_gets_the_file_that_another_one_has_from_a_device_with_an_equal_serial(
    node: Node, terminal: str
) -> None:
    """Where nothing but the kernel's name tells two apart, the second has the id of the first when that is unplugged."""
    twin = f"{ADAPTER}-ttyUSB1"
    node.allocate("first")
    node.allocate("second", result(device_id=twin))
    async with node.run(devices=(ZERO, device(twin, path=terminal))) as plugin:
        for name in ("first", "second"):
            assert (await node.kubelet.prepare(name)).error == ""
        plugin.update_devices([device(path=terminal), device(twin, path=terminal, present=False)])
        assert node.cdi.list_uids() == []
        await node.kubelet.unprepare("second")
        plugin.update_devices([device(path=terminal), device(twin, path=terminal, present=False)])
        assert node.cdi.list_uids() == ["uid-of-first"]


async def test_two_devices_that_change_their_paths_stay_with_their_claims(node: Node, terminal: str) -> None:
    node.allocate("first")
    node.allocate("second", result(device_id="serial-9"))
    swapped = [device(path="/dev/tty"), device("serial-9", path=terminal)]
    async with node.run(devices=(device(path=terminal), device("serial-9", path="/dev/tty"))) as plugin:
        for name in ("first", "second"):
            assert (await node.kubelet.prepare(name)).error == ""
        plugin.update_devices(swapped)
    assert node.spec("first")["devices"][0]["containerEdits"]["deviceNodes"][0]["hostPath"] == "/dev/tty"
    assert node.spec("second")["devices"][0]["containerEdits"]["mounts"][0]["hostPath"] == terminal
