"""The agent's writer on an API server: its object appears, follows the readings, and comes back."""

import msgspec
import pytest
from tests.live.agent.conftest import Robot
from tests.support.agent.agents import CAMERA, readings, status, trip

from robotapp_agent.devices.device import Device
from robotapp_agent.report.readings import Battery, Load
from robotapp_agent.report.status import status_of
from robotapp_client.api.resources import NODES, NODETELEMETRIES
from robotapp_client.transport.errors import NotFound


async def test_the_object_is_created_with_the_first_write_and_belongs_to_its_node(robot: Robot) -> None:
    with pytest.raises(NotFound):
        await robot.telemetry()
    await robot.writer.write(status())
    found = await robot.telemetry()
    (owner,) = found["metadata"]["ownerReferences"]
    assert (owner["kind"], owner["name"], owner["uid"]) == ("Node", robot.name, robot.uid)
    assert found["status"]["rtt"] == [
        {"peer": "edge-1", "p50Us": 1000, "p95Us": 2000, "jitterUs": 100, "lossPPM": 0, "seq": 7}
    ]
    assert found["status"]["devices"][0]["id"] == CAMERA.id


async def test_what_is_no_longer_there_vanishes_from_the_status(robot: Robot) -> None:
    await robot.writer.write(
        status(load=Load(1, 2, 3, 4, 5), battery=Battery(80, charging=False), device_problem="rule 3 is wrong")
    )
    await robot.writer.write(status(load=Load(cpu_percent=7), devices=(), round_trips=(trip("edge-2"),)))
    found = (await robot.telemetry())["status"]
    assert found["load"] == {"cpuPercent": 7}
    assert "battery" not in found
    assert "deviceProblem" not in found
    assert found["devices"] == []
    assert [entry["peer"] for entry in found["rtt"]] == ["edge-2"]


async def test_what_is_not_known_yet_leaves_what_an_earlier_run_wrote(robot: Robot) -> None:
    await robot.writer.write(status())
    await robot.writer.write(status(devices=None, round_trips=None, seq=8))
    found = (await robot.telemetry())["status"]
    assert (len(found["devices"]), len(found["rtt"]), found["seq"]) == (1, 1, 8)
    earlier = await robot.writer.earlier()
    assert earlier.seq == 8
    assert earlier.devices == (CAMERA,)


async def test_without_an_object_nothing_was_left_by_an_earlier_run(robot: Robot) -> None:
    assert (await robot.writer.earlier()).devices == ()


async def test_the_answer_of_a_write_tells_what_the_operator_wants_measured(robot: Robot) -> None:
    assert await robot.writer.write(status()) == ()
    await robot.client.patch(NODETELEMETRIES, robot.name, {"spec": {"probe": ["edge-1", "edge-2"]}})
    assert await robot.writer.write(status()) == ("edge-1", "edge-2")


async def test_an_object_that_somebody_deleted_is_created_again(robot: Robot) -> None:
    await robot.writer.write(status())
    await robot.client.delete(NODETELEMETRIES, robot.name)
    await robot.writer.write(status(seq=9))
    assert (await robot.telemetry())["status"]["seq"] == 9


async def test_the_telemetry_goes_with_its_node_and_the_new_node_of_that_name_owns_the_next(robot: Robot) -> None:
    await robot.writer.write(status())
    first = robot.uid
    await robot.client.delete(NODES, robot.name)
    await robot.gone()
    await robot.appear()
    assert robot.uid != first
    await robot.writer.write(status())
    (owner,) = (await robot.telemetry())["metadata"]["ownerReferences"]
    assert owner["uid"] == robot.uid


async def test_an_object_that_another_agent_created_meanwhile_is_taken_over(robot: Robot) -> None:
    await robot.client.create(NODETELEMETRIES, {"metadata": {"name": robot.name}})
    await robot.writer._create()
    await robot.writer.write(status())
    assert (await robot.telemetry())["status"]["seq"] == 7


async def test_the_answers_tell_the_offset_of_the_clock(robot: Robot) -> None:
    await robot.writer.write(status())
    assert robot.offset.reported_ms == 0


async def test_what_the_schema_refuses_is_left_out_and_devices_stay_as_they_were(robot: Robot) -> None:
    if not robot.real:
        pytest.skip("the fake knows no schemas")
    await robot.writer.write(status_of(readings(devices=(CAMERA,), seq=8)))
    bad = msgspec.structs.replace(CAMERA, id="No Label")
    await robot.writer.write(status_of(readings(devices=(bad,), seq=9)))
    assert "status.devices" in robot.writer.refused
    found = (await robot.telemetry())["status"]
    assert found["seq"] == 9
    assert [device["id"] for device in found["devices"]] == [CAMERA.id]
    can = Device(id="can-can0", type="can", interface="can0", names=("can-arm",))
    await robot.writer.write(status_of(readings(devices=(can,), seq=10)))
    assert [device["id"] for device in (await robot.telemetry())["status"]["devices"]] == [CAMERA.id]


async def test_every_field_is_accepted_by_the_schema(robot: Robot) -> None:
    can = Device(id="can-can0", type="can", model="pcan", interface="can0", names=("can-arm",), present=False)
    full = readings(
        devices=(can, CAMERA),
        load=Load(1, 2, 3, 4, 5),
        battery=Battery(80, charging=True),
        clock_offset_ms=-3000,
        round_trips=(trip(every_rounds=4), trip("dark", p50_us=None)),
    )
    await robot.writer.write(status_of(full))
    assert robot.writer.refused == ""
    found = (await robot.telemetry())["status"]
    assert found["devices"][0]["names"] == ["can-arm"]
    assert found["clock"] == {"offsetMilliseconds": -3000}
    assert found["rtt"][0] == {"peer": "dark", "lossPPM": 1_000_000, "seq": 7}
