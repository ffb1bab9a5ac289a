"""What the simulated agents write, against a recording stand-in for the API server."""

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotapp_api.model.telemetry import NodeTelemetry
from robotapp_testbed import ApiStatusError, ControlPlane, TestbedError, wait_until
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.telemetry import PEER_LIMIT, SimulatedTelemetry
from robotapp_testbed.machines.topology import Device, edge, fleet, robot

CAN = Device("can0", "can", interface="can0")


class RecordingApi:
    def __init__(self) -> None:
        self.created: list[Mapping[str, Any]] = []
        self.written: dict[str, Mapping[str, Any]] = {}
        self.rounds = 0
        self.probe: list[str] = []
        self.exists = False
        self.gone: set[str] = set()
        self.down = threading.Event()

    def get(self, path: str) -> Any:
        if path.startswith("/api/v1/nodes/"):
            if path.endswith("robot-1"):
                return {"metadata": {"name": "robot-1", "uid": "u-2"}}
            raise ApiStatusError("GET", path, 404, "not found")
        self.rounds += 1
        if self.down.is_set():
            raise ConnectionRefusedError("down")
        return {"items": [{"metadata": {"name": "robot-1", "uid": "u-1"}, "spec": {"probe": self.probe}}]}

    def create(self, path: str, obj: Mapping[str, Any]) -> None:
        if self.exists:
            raise ApiStatusError("POST", path, 409, "exists")
        self.created.append(obj)

    def patch(self, path: str, obj: Mapping[str, Any]) -> None:
        if path.split("/")[-2] in self.gone:
            self.gone.discard(path.split("/")[-2])
            raise ApiStatusError("PATCH", path, 404, "not found")
        self.written[path.split("/")[-2]] = obj["status"]

    def each(self, action: Callable[[Any], object], items: Iterable[Any]) -> None:
        for item in items:
            action(item)


class FakePlane:
    def __init__(self) -> None:
        self.api = RecordingApi()


def telemetry(world: Topology, *, interval_s: int | None = None) -> tuple[SimulatedTelemetry, RecordingApi]:
    plane = FakePlane()
    return SimulatedTelemetry(cast(ControlPlane, plane), world, interval_s=interval_s), plane.api


def test_the_node_owns_its_telemetry_and_one_that_came_back_gets_a_new_object() -> None:
    writer, api = telemetry(fleet())
    with writer:
        owners = {obj["metadata"]["name"]: obj["metadata"]["ownerReferences"] for obj in api.created}
        owner = {"apiVersion": "v1", "kind": "Node", "name": "robot-1", "uid": "u-1"}
        assert owners["robot-1"] == [owner]
        assert owners["edge-1"] == [], "a node that is not there owns nothing"
        api.gone = {"robot-1", "edge-1"}
        api.created.clear()
        writer.write("robot-1", "edge-1")
    assert [obj["metadata"]["name"] for obj in api.created] == ["robot-1"]
    assert api.created[0]["metadata"]["ownerReferences"][0]["uid"] == "u-2"


def test_an_infinite_round_trip_is_one_that_no_probe_came_back_from() -> None:
    writer, api = telemetry(fleet())
    with writer:
        writer.set_rtt("robot-1", "edge-1", float("inf"))
    (entry,) = (entry for entry in api.written["edge-1"]["rtt"] if entry["peer"] == "robot-1")
    assert (entry["lossPPM"], "p50Us" in entry, "p95Us" in entry) == (1_000_000, False, False)


def test_every_object_is_labelled_as_simulated_and_fits_the_model() -> None:
    writer, api = telemetry(fleet(devices={"robot-1": [CAN]}))
    with writer:
        pass
    assert {obj["metadata"]["labels"]["robotics.io/simulated"] for obj in api.created} == {"true"}
    for obj in api.created:
        name = obj["metadata"]["name"]
        parsed = NodeTelemetry.model_validate({**obj, "status": api.written[name]})
        assert len(parsed.status.rtt) == 4


def test_objects_that_exist_are_taken_over() -> None:
    writer, api = telemetry(fleet())
    api.exists = True
    with writer:
        assert set(api.written) == {"robot-1", "robot-2", "edge-1", "edge-2", "cloud-1"}


def test_a_changed_round_trip_is_written_at_both_ends_at_once() -> None:
    writer, api = telemetry(fleet())
    writer.set_rtt("edge-1", "robot-1", 45.0)
    assert set(api.written) == {"edge-1", "robot-1"}
    ends = [peer for status in api.written.values() for peer in status["rtt"] if peer["peer"] in {"edge-1", "robot-1"}]
    assert [peer["p50Us"] for peer in ends] == [45_000, 45_000]


def test_unplugging_a_device_keeps_it_listed_as_absent() -> None:
    writer, api = telemetry(fleet(devices={"robot-1": [CAN]}))
    writer.unplug("robot-1", "can0")
    assert api.written["robot-1"]["devices"] == [{"id": "can0", "type": "can", "present": False, "interface": "can0"}]
    writer.plug("robot-1", "can0")
    assert api.written["robot-1"]["devices"][0]["present"] is True


def test_a_device_the_node_does_not_have_is_explained() -> None:
    writer, _ = telemetry(fleet(devices={"robot-1": [CAN]}))
    with pytest.raises(TestbedError, match="robot-1 has no device 'lidar', it has can0"):
        writer.unplug("robot-1", "lidar")


def test_load_appears_once_it_is_set() -> None:
    writer, api = telemetry(fleet())
    writer.write("edge-1")
    assert "load" not in api.written["edge-1"]
    writer.set_load("edge-1", cpu=80)
    assert api.written["edge-1"]["load"] == {"cpuPercent": 80}


def test_every_write_has_the_next_sequence_number() -> None:
    writer, api = telemetry(fleet())
    numbers = []
    for _ in range(3):
        writer.write("edge-1")
        status = api.written["edge-1"]
        numbers.append((status["seq"], {entry["seq"] for entry in status["rtt"]}))
    assert numbers == [(1, {1}), (2, {2}), (3, {3})], "every pair is measured in every round"


def test_a_silent_agent_writes_nothing_until_it_speaks() -> None:
    writer, api = telemetry(fleet())
    writer.silence("edge-1")
    writer.write()
    assert "edge-1" not in api.written
    writer.speak("edge-1")
    assert "edge-1" in api.written


def test_the_heartbeat_survives_an_absent_api_server() -> None:
    writer, api = telemetry(fleet(), interval_s=cast(int, 0.01))
    with writer:
        api.down.set()
        failed_at = api.rounds
        assert wait_until(lambda: api.rounds > failed_at + 2, timeout_s=60)
        api.down.clear()
        before = api.written["edge-1"]["seq"]
        assert wait_until(lambda: api.written["edge-1"]["seq"] > before, timeout_s=60)


@pytest.mark.parametrize(("count", "interval_s"), [(5, 10), (500, 10), (1000, 20)])
def test_large_fleets_write_less_often(count: int, interval_s: int) -> None:
    writer, _ = telemetry(Topology([edge(f"edge-{number}") for number in range(count)]))
    assert writer.status("edge-0")["intervalSeconds"] == interval_s


@settings(max_examples=30)
@given(count=st.integers(1, 150), zones=st.integers(1, 80), asked=st.lists(st.integers(0, 200), max_size=16))
def test_peers_are_bounded_distinct_others_and_those_asked_for_come_first(
    count: int, zones: int, asked: list[int]
) -> None:
    world = Topology([robot(f"r-{number}", zone=f"z-{number % zones}") for number in range(count)])
    writer, _ = telemetry(world)
    wanted = [f"r-{number}" for number in asked]
    peers = [entry["peer"] for entry in writer.status("r-0", asked=wanted)["rtt"]]
    assert len(peers) == len(set(peers)) <= PEER_LIMIT
    if count - 1 <= PEER_LIMIT:
        assert set(peers) == world.nodes.keys() - {"r-0"}
    else:
        first = list(dict.fromkeys(name for name in wanted if name in world.nodes and name != "r-0"))
        assert peers[: len(first)] == first
        assert "r-0" not in peers
