"""The driver as the kubelet meets it: over its sockets, with an API server, killed and started again."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from tests.support.agent.dra import ADAPTER, BOOT, NODE, config, device, fields, result
from tests.support.agent.driver_node import ZERO, Node, SlowRead
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, until

from robotapp_agent.driver.kubelet import KubeletServer, SocketGoneError
from robotapp_agent.driver.messages import ClaimReference
from robotapp_agent.driver.node_files import DeviceFiles
from robotapp_agent.driver.plugin import DevicePlugin, NodeFolders, Patience
from robotapp_claims.rules.identity import claim_name_device
from robotapp_client.api.resources import RESOURCECLAIMS, ROBOTCLAIMS
from robotapp_client.transport.errors import NotFound, Unreachable


async def test_the_kubelet_registers_the_driver(node: Node) -> None:
    async with node.run():
        info = fields(await node.kubelet.register())
        assert info == {
            1: [b"DRAPlugin"],
            2: [b"devices.robotics.io"],
            3: [str(node.kubelet.endpoint).encode()],
            4: [b"v1.DRAPlugin"],
        }
        assert node.registrations == 1
        await node.kubelet.register(error="a plugin of this name is there")
        assert node.registrations == 1
    assert not node.kubelet.registration.exists()


async def test_a_prepared_claim_has_a_spec_that_the_runtime_finds_by_its_id(node: Node) -> None:
    node.allocate("driver", configs=[config(env="LIDAR", mountAs="/dev/lidar")])
    async with node.run():
        answer = await node.kubelet.prepare("driver")
    spec = node.spec("driver")
    assert answer.error == ""
    assert answer.cdi_ids == [f"{spec['kind']}={entry['name']}" for entry in spec["devices"]]
    edits = spec["devices"][0]["containerEdits"]
    assert edits["env"] == ["ROBOTAPP_DEVICE_LIDAR=/dev/lidar"]
    assert edits["deviceNodes"][0]["hostPath"] == "/dev/zero"


async def test_preparing_twice_gives_the_same_answer(node: Node) -> None:
    node.allocate("driver")
    async with node.run():
        assert await node.kubelet.prepare("driver") == await node.kubelet.prepare("driver")


async def test_a_device_in_use_is_refused_until_it_is_given_back(node: Node) -> None:
    for name in ("first", "second"):
        node.allocate(name)
    async with node.run():
        assert (await node.kubelet.prepare("first")).error == ""
        assert "in use by claim first" in (await node.kubelet.prepare("second")).error
        await node.kubelet.unprepare("first")
        node.deallocate("first")
        assert (await node.kubelet.prepare("second")).error == ""
    assert node.cdi.list_uids() == ["uid-of-second"]


@pytest.mark.parametrize("restart", ["no", "driver", "machine"])
async def test_between_two_pods_of_a_claim_no_other_claim_gets_its_device(node: Node, restart: str) -> None:
    for name in ("first", "second"):
        node.allocate(name)
    async with node.run():
        await node.kubelet.prepare("first")
        await node.kubelet.unprepare("first")
        assert node.cdi.list_uids() == []
        if restart == "no":
            assert "in use by claim first" in (await node.kubelet.prepare("second")).error
    async with node.run(boot_id="boot-2" if restart == "machine" else BOOT) as plugin:
        await plugin.forget_gone_claims()
        assert node.cdi.list_uids() == []
        assert "in use by claim first" in (await node.kubelet.prepare("second")).error
        assert (await node.kubelet.prepare("first")).error == ""


@pytest.mark.parametrize("change", ["deleted", "made anew", "deallocated", "given another device"])
async def test_a_claim_that_has_its_device_no_more_keeps_it_from_nobody(node: Node, change: str) -> None:
    for name in ("first", "second"):
        node.allocate(name)
    async with node.run():
        await node.kubelet.prepare("first")
        await node.kubelet.unprepare("first")
        match change:
            case "deleted":
                await node.client.delete(RESOURCECLAIMS, "first", namespace="fleet")
            case "made anew":
                node.allocate("first", uid="uid-of-its-successor")
            case "deallocated":
                node.deallocate("first")
            case _:
                node.allocate("first", result(device_id="serial-9"))
        assert (await node.kubelet.prepare("second")).error == ""
    assert set(node.checkpoint.load().claims) == {"uid-of-second"}


@pytest.mark.parametrize(
    "answer", [Unreachable("reset", maybe_applied=False), NotFound("404 page not found", status=404)]
)
async def test_a_claim_that_cannot_be_read_keeps_its_device(
    node: Node, monkeypatch: pytest.MonkeyPatch, answer: Exception
) -> None:
    for name in ("first", "second"):
        node.allocate(name)
    plugin = node.start_plugin()
    first, second = (ClaimReference("fleet", f"uid-of-{name}", name) for name in ("first", "second"))
    await plugin.prepare(first)
    await plugin.unprepare(first)
    node.deallocate("first")
    get = node.client.get

    async def fail(resource: Any, name: str, **options: Any) -> Any:
        if name == "first":
            raise answer
        return await get(resource, name, **options)

    with monkeypatch.context() as broken:
        broken.setattr(node.client, "get", fail)
        assert "in use by claim first" in str(await plugin.prepare(second))
    assert not isinstance(await plugin.prepare(second), str)


async def test_a_claim_that_comes_back_while_it_is_looked_up_keeps_its_device(
    node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was read of it is older than its last preparation."""
    for name in ("first", "second"):
        node.allocate(name)
    plugin = node.start_plugin()
    first, second = (ClaimReference("fleet", f"uid-of-{name}", name) for name in ("first", "second"))
    await plugin.prepare(first)
    await plugin.unprepare(first)
    node.deallocate("first")
    get = node.client.get
    monkeypatch.setattr(node.client, "get", read_first := SlowRead(get, "first"))
    taking_over = asyncio.create_task(plugin.prepare(second))
    await read_first.was_read.wait()
    node.allocate("first")
    monkeypatch.setattr(node.client, "get", get)
    assert not isinstance(await plugin.prepare(first), str)
    await plugin.unprepare(first)
    read_first.may_return.set()
    assert "in use by claim first" in str(await taking_over)


async def test_a_claim_is_not_given_another_device_below_a_container(node: Node) -> None:
    node.allocate("driver")
    other = device("serial-9", path="/dev/full")
    async with node.run(devices=(ZERO, other)):
        await node.kubelet.prepare("driver")
        node.allocate("driver", result(device_id="serial-9"))
        assert "a container may still have" in (await node.kubelet.prepare("driver")).error
        assert node.checkpoint.load().device_ids == {ADAPTER}
        await node.kubelet.unprepare("driver")
        assert (await node.kubelet.prepare("driver")).error == ""
        assert node.checkpoint.load().device_ids == {"serial-9"}


async def test_a_claim_prepared_after_a_reboot_without_the_api_server_counts_as_prepared(short_folder: Path) -> None:
    async with FakeApiServer() as api, client_for(api.endpoint, timeout_s=0.2) as client:
        node = Node(short_folder, api, client)
        node.allocate("driver")
        async with node.run(boot_id="boot-1"):
            await node.kubelet.prepare("driver")
        async with node.run(boot_id="boot-2"):
            api.failing += [503] * 40
            assert (await node.kubelet.prepare("driver")).error == ""
        (claim,) = node.checkpoint.load().claims.values()
        assert claim.is_prepared("boot-2")


async def test_a_device_that_becomes_free_is_handed_over_at_once(node: Node) -> None:
    for name in ("first", "second"):
        node.allocate(name)
    node.patience = Patience(0, 60, look_again_s=0.01)
    async with node.run():
        await node.kubelet.prepare("first")
        assert "in use by claim first" in (await node.kubelet.prepare("second")).error
        waiting = asyncio.create_task(node.kubelet.prepare("second"))
        requests = len(node.api.requests)
        await until(lambda: len(node.api.requests) > requests)
        await node.kubelet.unprepare("first")
        node.deallocate("first")
        assert (await waiting).error == ""


async def test_a_claim_waits_for_a_holder_that_is_about_to_end_without_being_refused_first(node: Node) -> None:
    """The holder's claim goes at once, its pod takes its grace period: a refusal would cost the 12 s until the kubelet's next try."""
    for name in ("first", "second"):
        node.allocate(name)
    node.patience = Patience(0, 60, look_again_s=0.01)
    async with node.run():
        await node.kubelet.prepare("first")
        node.api.store.remove(RESOURCECLAIMS, "first", "fleet")
        waiting = asyncio.create_task(node.kubelet.prepare("second"))
        await until(lambda: "/first" in node.api.requests[-1][1])
        await node.kubelet.unprepare("first")
        assert (await waiting).error == ""


async def test_a_claim_that_was_deleted_while_it_waited_takes_nothing(node: Node) -> None:
    for name in ("first", "second"):
        node.allocate(name)
    node.patience = Patience(60, 60, look_again_s=0.01)
    async with node.run():
        await node.kubelet.prepare("first")
        waiting = asyncio.create_task(node.kubelet.prepare("second"))
        await until(lambda: "/first" in node.api.requests[-1][1])
        node.api.store.remove(RESOURCECLAIMS, "second", "fleet")
        await node.kubelet.unprepare("first")
        node.deallocate("first")
        assert "cannot be read" in (await waiting).error
    assert node.cdi.list_uids() == []


async def test_a_device_that_a_robotclaim_holds_is_refused_unless_the_claim_had_it_before(node: Node) -> None:
    robotclaim = claim_name_device(NODE, ADAPTER)
    async with node.run():
        await node.client.create(ROBOTCLAIMS, {"metadata": {"name": robotclaim}, "spec": {}})
        node.allocate("driver")
        assert f"in use by RobotClaim {robotclaim}" in (await node.kubelet.prepare("driver")).error
        await node.client.delete(ROBOTCLAIMS, robotclaim)
        assert (await node.kubelet.prepare("driver")).error == ""
        await node.kubelet.unprepare("driver")
        await node.client.create(ROBOTCLAIMS, {"metadata": {"name": robotclaim}, "spec": {}})
        assert (await node.kubelet.prepare("driver")).error == ""


async def test_a_holder_in_another_namespace_is_not_named(node: Node) -> None:
    node.allocate("first")
    node.allocate("second", namespace="other")
    async with node.run():
        await node.kubelet.prepare("first")
        answer = await node.kubelet.prepare("second", namespace="other")
    assert "in use by a claim of another namespace" in answer.error
    assert "first" not in answer.error


async def test_of_many_claims_that_come_at_once_one_gets_the_device(node: Node) -> None:
    names = [f"claim-{number}" for number in range(8)]
    for name in names:
        node.allocate(name)
    async with node.run():
        answers = await asyncio.gather(*map(node.kubelet.prepare, names))
    assert sum(not answer.error for answer in answers) == 1
    assert len(node.cdi.list_uids()) == 1


async def test_a_driver_that_was_killed_refuses_what_it_had_given_away(node: Node) -> None:
    for name in ("first", "second"):
        node.allocate(name)
    async with node.run():
        before = await node.kubelet.prepare("first")
    async with node.run():
        assert "in use by claim first" in (await node.kubelet.prepare("second")).error
        assert await node.kubelet.prepare("first") == before


async def test_a_driver_killed_between_lock_and_spec_finishes_when_it_is_back(node: Node) -> None:
    node.allocate("first")
    async with node.run():
        await node.kubelet.prepare("first")
    node.cdi.remove("uid-of-first")
    async with node.run():
        assert node.cdi.list_uids() == ["uid-of-first"]


async def test_a_spec_without_entry_in_the_checkpoint_is_removed(node: Node) -> None:
    node.cdi.write("uid-of-nobody", {"kind": "devices.robotics.io/device", "devices": []})
    async with node.run():
        assert node.cdi.list_uids() == []


async def test_a_full_disk_refuses_the_claim_and_locks_nothing(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    node.allocate("first")
    node.allocate("second")
    async with node.run():
        with monkeypatch.context() as broken:
            broken.setattr("robotapp_agent.driver.node_files.os.fsync", _no_space)
            assert "no space left" in (await node.kubelet.prepare("first")).error
        assert node.cdi.list_uids() == []
        assert (await node.kubelet.prepare("second")).error == ""


def _no_space(_: int) -> None:
    raise OSError("no space left")


async def test_without_the_api_server_prepared_claims_stay_prepared(short_folder: Path) -> None:
    async with FakeApiServer() as api, client_for(api.endpoint, timeout_s=0.2) as client:
        node = Node(short_folder, api, client)
        node.allocate("driver")
        async with node.run():
            before = await node.kubelet.prepare("driver")
            api.failing += [503] * 40
            assert await node.kubelet.prepare("driver") == before
            assert "cannot be read" in (await node.kubelet.prepare("other")).error


async def test_a_deleted_claim_is_not_prepared_again(node: Node) -> None:
    node.allocate("driver")
    async with node.run():
        await node.kubelet.prepare("driver")
        await node.client.delete(RESOURCECLAIMS, "driver", namespace="fleet")
        assert "cannot be read" in (await node.kubelet.prepare("driver")).error


async def test_after_a_reboot_a_claim_that_is_gone_frees_its_device(node: Node) -> None:
    node.allocate("first")
    node.allocate("second")
    async with node.run(boot_id="boot-1"):
        await node.kubelet.prepare("first")
    await node.client.delete(RESOURCECLAIMS, "first", namespace="fleet")
    async with node.run(boot_id="boot-1"):
        assert "in use by claim first" in (await node.kubelet.prepare("second")).error
    async with node.run(boot_id="boot-2"):
        assert (await node.kubelet.prepare("second")).error == ""


async def test_after_a_reboot_a_claim_that_stands_keeps_its_device(node: Node) -> None:
    node.allocate("first")
    node.allocate("second")
    async with node.run(boot_id="boot-1"):
        await node.kubelet.prepare("first")
    async with node.run(boot_id="boot-2") as plugin:
        await plugin.forget_gone_claims()
        assert "in use by claim first" in (await node.kubelet.prepare("second")).error
        assert (await node.kubelet.prepare("first")).error == ""


async def test_the_start_after_a_reboot_forgets_claims_that_are_gone(node: Node) -> None:
    node.allocate("first")
    async with node.run(boot_id="boot-1"):
        await node.kubelet.prepare("first")
    await node.client.delete(RESOURCECLAIMS, "first", namespace="fleet")
    async with node.run(boot_id="boot-2") as plugin:
        await plugin.forget_gone_claims()
    assert node.cdi.list_uids() == []
    assert node.checkpoint.load().claims == {}


async def test_a_device_at_another_path_changes_the_spec_of_its_claim(node: Node) -> None:
    node.allocate("driver")
    async with node.run() as plugin:
        await node.kubelet.prepare("driver")
        plugin.update_devices([device(path="/dev/full")])
    edits = node.spec("driver")["devices"][0]["containerEdits"]
    assert edits["env"] == ["ROBOTAPP_DEVICE_LIDAR=/dev/full"]
    assert edits["deviceNodes"][0]["hostPath"] == "/dev/full"


async def test_claims_of_one_pod_wait_for_their_devices_together(node: Node) -> None:
    """The kubelet's patience is for its call, so one wait after the other would exceed it."""
    other = device("serial-9", path="/dev/full")
    for name in ("first", "second"):
        node.allocate(name)
    for name in ("third", "fourth"):
        node.allocate(name, result(device_id="serial-9"))
    node.patience = Patience(60, 60, look_again_s=0.01)
    async with node.run(devices=(ZERO, other)):
        for name in ("first", "third"):
            await node.kubelet.prepare(name)
        waiting = asyncio.create_task(node.kubelet.prepare_all("second", "fourth"))
        await node.kubelet.unprepare("third")
        node.deallocate("third")
        await until(lambda: "uid-of-fourth" in node.checkpoint.load().claims)
        assert not waiting.done()
        await node.kubelet.unprepare("first")
        node.deallocate("first")
        assert [answer.error for answer in await waiting] == ["", ""]


async def test_a_claim_that_is_given_back_while_it_is_prepared_takes_nothing(
    node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kubelet gives it back once, after it has cancelled the preparation: nobody would give the device back again."""
    node.allocate("first")
    plugin = node.start_plugin()
    first = ClaimReference("fleet", "uid-of-first", "first")
    monkeypatch.setattr(node.client, "get", read := SlowRead(node.client.get, "first"))
    preparing = asyncio.create_task(plugin.prepare(first))
    await read.was_read.wait()
    assert await plugin.unprepare(first) == ""
    read.may_return.set()
    assert "was given back by the kubelet" in str(await preparing)
    assert node.checkpoint.load().claims == {}


async def test_a_preparation_ends_with_a_reason_before_the_kubelet_gives_up(
    node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    node.allocate("first")
    node.patience = Patience(call_s=0.01)
    plugin = node.start_plugin()
    monkeypatch.setattr(node.client, "get", SlowRead(node.client.get, "first"))
    answer = await plugin.prepare(ClaimReference("fleet", "uid-of-first", "first"))
    assert "the API server answers too slowly" in str(answer)
    assert node.checkpoint.load().claims == {}


async def test_a_device_whose_file_is_gone_is_refused(node: Node) -> None:
    node.allocate("driver")
    async with node.run(devices=(device(path="/dev/ttyUSB77"),)):
        assert "no device file any more" in (await node.kubelet.prepare("driver")).error


async def test_an_unknown_device_is_refused_and_others_are_not_touched(node: Node) -> None:
    node.allocate("driver", result(device_id="serial-9"))
    async with node.run():
        assert "has no device serial-9" in (await node.kubelet.prepare("driver")).error
        assert node.cdi.list_uids() == []


async def test_nothing_is_prepared_where_containers_would_not_get_it(node: Node) -> None:
    node.allocate("driver")
    folders = NodeFolders(node.checkpoint, node.cdi, DeviceFiles(Path("/")))
    problem = "its container runtime is old"
    plugin = DevicePlugin(node.client, folders, node=NODE, boot_id=BOOT, runtime_problem=lambda: problem)
    plugin.update_devices([ZERO])
    answer = await plugin.prepare(ClaimReference("fleet", "uid-of-driver", "driver"))
    assert answer == "node robot-1 hands out no devices: its container runtime is old"


async def test_giving_back_what_was_never_prepared_is_no_error(node: Node) -> None:
    async with node.run():
        (entry,) = fields(await node.kubelet.unprepare("driver"))[1]
    assert fields(entry)[2] == [b""]


async def test_a_removed_socket_ends_the_driver(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotapp_agent.driver.kubelet.CHECK_S", 0.01)
    server = KubeletServer(node.start_plugin(), node.folder, registered=lambda: None)
    task = asyncio.create_task(server.run())
    await node.kubelet.wait_for_driver()
    node.kubelet.registration.unlink()
    with pytest.raises(SocketGoneError, match="was removed"):
        await task


async def test_the_adapter_of_the_other_tests_is_the_one_of_the_checkpoint(node: Node) -> None:
    node.allocate("driver")
    async with node.run():
        await node.kubelet.prepare("driver")
    assert node.checkpoint.load().device_ids == {ADAPTER}
