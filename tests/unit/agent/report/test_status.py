"""Readings as the status that is sent to the API server."""

import json
from typing import Any

import msgspec
from tests.support.agent.agents import CAMERA, readings, status, trip

from robotapp_agent.devices.device import Device
from robotapp_agent.report.readings import Battery, Load, Readings, Temperature
from robotapp_agent.report.status import SECTIONS, patch_of, shown, status_of, without
from robotapp_api.model.telemetry import NodeTelemetry, TelemetryStatus


def sent(found: Readings) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(patch_of(status_of(found)))["status"]
    return result


def full() -> Readings:
    return readings(
        load=Load(1, 2, 3, 4, 5),
        temperatures=(Temperature("cpu-thermal", 51),),
        battery=Battery(80, charging=True),
        clock_offset_ms=-3000,
        realtime=True,
        device_problem="rule 3: no such attribute",
        round_trips=(trip(every_rounds=4), trip("dark", p50_us=None)),
    )


def test_every_field_of_the_schema_is_written_under_its_name() -> None:
    fields = {field.alias or name for name, field in TelemetryStatus.model_fields.items()}
    assert set(sent(full())) == fields == SECTIONS
    parsed = NodeTelemetry.model_validate({"status": sent(full())}).status
    assert (parsed.interval_seconds, parsed.seq, parsed.arch) == (10, 7, "arm64")
    assert parsed.kernel
    assert parsed.kernel.realtime
    assert parsed.load
    assert (parsed.load.cpu_percent, parsed.load.disk_percent, parsed.load.network_bps) == (1, 3, 5)
    assert parsed.battery
    assert (parsed.battery.percent, parsed.battery.charging) == (80, True)
    assert parsed.clock
    assert parsed.clock.offset_milliseconds == -3000
    assert parsed.temperatures[0].celsius == 51
    dark, edge = parsed.rtt
    assert (dark.peer, dark.p50_us, dark.loss_ppm) == ("dark", None, 1_000_000)
    assert (edge.p50_us, edge.p95_us, edge.jitter_us, edge.seq, edge.every_rounds) == (1000, 2000, 100, 7, 4)
    assert parsed.devices[0].id == CAMERA.id


def test_a_field_without_a_value_is_sent_as_null_so_that_the_merge_removes_what_was_stored() -> None:
    found = sent(readings(load=Load(cpu_percent=3)))
    assert found["load"] == {
        "cpuPercent": 3,
        "memoryPercent": None,
        "diskPercent": None,
        "gpuPercent": None,
        "networkBps": None,
    }
    assert (found["battery"], found["clock"], found["temperatures"]) == (None, None, None)
    assert sent(readings(load=Load()))["load"] is None


def test_entries_of_lists_leave_out_what_has_no_value_because_lists_are_replaced_whole() -> None:
    found = sent(readings(round_trips=(trip(p50_us=None),), devices=(Device(id="can-can0", type="can"),)))
    assert found["rtt"] == [{"peer": "edge-1", "lossPPM": 1_000_000, "seq": 7}]
    assert found["devices"] == [{"id": "can-can0", "type": "can", "present": True}]


def test_what_is_not_known_yet_is_not_sent_so_that_what_an_earlier_run_wrote_stays() -> None:
    found = sent(readings(devices=None, round_trips=None))
    assert "devices" not in found
    assert "rtt" not in found


def test_an_empty_list_is_sent_because_it_is_known_that_nothing_is_there() -> None:
    found = sent(readings(devices=(), round_trips=()))
    assert (found["devices"], found["rtt"]) == ([], [])


def test_lists_keep_to_the_bounds_of_the_schema_and_drop_what_matters_least() -> None:
    gone = tuple(msgspec.structs.replace(CAMERA, id=f"usb-{number}", present=False) for number in range(100))
    here = tuple(msgspec.structs.replace(CAMERA, id=f"video-{number}") for number in range(100))
    trips = tuple(trip(f"node-{number}", seq=number) for number in range(90))
    heat = tuple(Temperature(f"zone-{number}", 40) for number in range(30))
    found = sent(readings(devices=gone + here, round_trips=trips, temperatures=heat))
    assert len(found["devices"]) == 128
    assert sum(device["present"] for device in found["devices"]) == 100
    assert [device["id"] for device in found["devices"]] == sorted(device["id"] for device in found["devices"])
    assert {entry["seq"] for entry in found["rtt"]} == set(range(26, 90))
    assert len(found["temperatures"]) == 16


def test_of_parts_that_the_server_refuses_devices_and_round_trips_stay_as_stored_and_others_go() -> None:
    found = json.loads(patch_of(without(status(load=Load(1)), {"devices", "load", "no such part"})))["status"]
    assert "devices" not in found
    assert found["load"] is None
    assert found["rtt"]


def test_people_see_no_fields_without_a_value() -> None:
    assert shown(status(load=Load(cpu_percent=3), devices=None)).keys() == {
        "intervalSeconds",
        "seq",
        "arch",
        "kernel",
        "rtt",
        "load",
    }
    assert shown(status(load=Load(cpu_percent=3)))["load"] == {"cpuPercent": 3}
