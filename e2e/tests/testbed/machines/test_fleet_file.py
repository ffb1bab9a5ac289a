"""Fleets in YAML: names, zones and devices of nodes, and what is wrong with a file."""

from pathlib import Path
from typing import Any

import pytest

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines import fleet_file
from robotapp_testbed.machines.fleet_file import topology_of
from robotapp_testbed.machines.nodes import Device

EXAMPLE = Path(__file__).parents[4] / "examples" / "fleet" / "factory.yaml"


def test_the_example_has_the_robot_and_the_bus_of_the_other_examples() -> None:
    fleet = fleet_file.read(EXAMPLE)
    assert list(fleet.nodes) == ["amr-07", "amr-08", "edge-1", "edge-2", "cloud-1"]
    assert fleet.node("amr-07").devices == (Device("can-can0", "can", interface="can0"),)
    assert fleet.rtt_ms("amr-07", "edge-1") < fleet.rtt_ms("amr-07", "cloud-1")


@pytest.mark.parametrize(
    ("document", "reason"),
    [
        ({"robot": 1}, "unknown field `robot`"),
        ({"robots": [{"name": "a", "device": []}]}, r"unknown field `device` - at `robots"),
        ({"robots": [{"name": "a", "devices": [{"interface": "can0"}]}]}, "missing required field `type`"),
        ({"robots": [{"name": "a", "devices": [{"type": "can"}]}]}, "devices of a: a can has an interface"),
        (
            {"robots": [{"name": "a", "devices": [{"type": "video", "identity": "046d"}]}]},
            "identity '046d' is not vid:pid or vid:pid:serial",
        ),
        ({"robots": [{"name": "a", "devices": [{"type": "can", "interface": "can0"}] * 2}]}, "devices of a: two have"),
        ({"robots": ["a", "a"]}, "two nodes have the same name"),
        ({"robots": -1}, "`robots`"),
        ({"robots": 1_000_000}, "`robots`"),
        ({}, "a fleet has at least one node"),
        (None, "Expected `object`"),
        ([], "Expected `object`"),
    ],
)
def test_what_is_wrong_with_a_fleet_is_told_with_its_place(document: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        topology_of(document)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    for content in (b"robots: [", b"\xff\xfe", b"robots: {}", b"#" * (fleet_file.MOST_BYTES + 1)):
        path = tmp_path / "fleet.yaml"
        path.write_bytes(content)
        with pytest.raises(TestbedError, match=r"fleet\.yaml"):
            fleet_file.read(path)
    with pytest.raises(TestbedError, match=r"none\.yaml cannot be read"):
        fleet_file.read(tmp_path / "none.yaml")
