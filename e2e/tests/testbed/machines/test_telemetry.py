"""What the simulated agents write, against a recording stand-in for the API server."""

from collections.abc import Callable, Iterable, Mapping
from types import SimpleNamespace
from typing import Any, cast

from robotapp_api.model.telemetry import NodeTelemetry
from robotapp_testbed import ApiStatusError, ControlPlane
from robotapp_testbed.machines.telemetry import SimulatedTelemetry
from robotapp_testbed.machines.topology import Device, fleet


class RecordingApi:
    def __init__(self) -> None:
        self.created: list[Mapping[str, Any]] = []
        self.statuses: dict[str, Mapping[str, Any]] = {}

    def get(self, path: str) -> Any:
        if path.startswith("/api/v1/nodes/"):
            raise ApiStatusError("GET", path, 404, "not found")
        return {"items": []}

    def create(self, _path: str, obj: Mapping[str, Any]) -> None:
        self.created.append(obj)

    def patch(self, path: str, obj: Mapping[str, Any]) -> None:
        self.statuses[path.split("/")[-2]] = obj["status"]

    def each(self, action: Callable[[Any], object], items: Iterable[Any]) -> None:
        for item in items:
            action(item)


def test_every_object_is_labelled_as_simulated_and_fits_the_model() -> None:
    api = RecordingApi()
    nodes = fleet(devices={"robot-1": [Device("can0", "can", interface="can0")]})
    with SimulatedTelemetry(cast(ControlPlane, SimpleNamespace(api=api)), nodes):
        pass
    assert {obj["metadata"]["labels"]["robotics.io/simulated"] for obj in api.created} == {"true"}
    for obj in api.created:
        parsed = NodeTelemetry.model_validate({**obj, "status": api.statuses[obj["metadata"]["name"]]})
        assert len(parsed.status.rtt) == 4


def test_the_first_function_of_a_usb_device_has_the_further_name_usb() -> None:
    api = RecordingApi()
    of_usb = [Device(name, kind, identity="8086:0b3a:7") for name, kind in (("video-1", "video"), ("sound-1", "sound"))]
    devices = [*of_usb, Device("usb-2", "usb", identity="1234:5678:1"), Device("can0", "can", interface="can0")]
    with SimulatedTelemetry(
        cast(ControlPlane, SimpleNamespace(api=api)), fleet(devices={"robot-1": devices})
    ) as agents:
        reported = agents.status("robot-1")["devices"]
    assert {each["id"]: each.get("names") for each in reported} == {
        "video-1": ["usb"],
        "sound-1": None,
        "usb-2": None,
        "can0": None,
    }
