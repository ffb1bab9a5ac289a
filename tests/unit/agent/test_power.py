"""Temperatures and batteries from the texts of sysfs."""

import pytest

from robotapp_agent.report.power import Sensor, battery, temperatures
from robotapp_agent.report.readings import Battery, Temperature


def test_a_monitor_of_a_zones_name_is_the_same_sensor_once_more() -> None:
    zones = [Sensor("cpu-thermal\n", "51234\n")]
    monitors = [Sensor("cpu_thermal", "51234"), Sensor("nvme Composite", "38850")]
    assert temperatures(zones, monitors) == (Temperature("cpu-thermal", 51), Temperature("nvme Composite", 39))


def test_sensors_of_one_name_are_numbered() -> None:
    found = temperatures([Sensor("cpu", "1000"), Sensor("cpu", "2000"), Sensor("cpu", "3000")], [])
    assert found == (Temperature("cpu", 1), Temperature("cpu-2", 2), Temperature("cpu-3", 3))


def test_a_number_that_another_sensor_has_in_its_name_is_not_given_twice() -> None:
    found = temperatures([Sensor("cpu", "1000"), Sensor("cpu-2", "2000"), Sensor("cpu", "3000")], [])
    assert [reading.name for reading in found] == ["cpu", "cpu-2", "cpu-3"]


@pytest.mark.parametrize(
    ("name", "value"),
    [("cpu", ""), ("cpu", "hot"), ("cpu", "-274000"), ("cpu", "9999999"), ("", "1000"), ("\x1b\x00", "1000")],
)
def test_a_broken_sensor_is_left_out(name: str, value: str) -> None:
    assert temperatures([Sensor(name, value)], []) == ()


def test_names_are_made_printable_and_sensors_are_bounded() -> None:
    assert temperatures([Sensor("a\x1b[31mb" + 200 * "c", "1000")], [])[0].name.startswith("a-31mb")
    many = temperatures([Sensor(f"zone{number}", "1000") for number in range(40)], [])
    assert len(many) == 16
    assert all(len(reading.name) <= 63 for reading in many)


def cell(**attributes: str) -> dict[str, str]:
    return {"type": "Battery\n", "scope": "System", "status": "Discharging\n", "capacity": "80\n"} | attributes


def test_a_battery_tells_its_charge_and_whether_it_is_on_external_power() -> None:
    assert battery([cell()]) == Battery(80, charging=False)
    assert battery([cell(status="Charging")]) == Battery(80, charging=True)
    assert battery([cell(), {"type": "Mains", "online": "1\n"}]) == Battery(80, charging=True)
    assert battery([cell(), {"type": "Mains", "online": "0\n"}]) == Battery(80, charging=False)


def test_several_batteries_count_by_their_size() -> None:
    large, small = cell(capacity="100", energy_full="3000"), cell(capacity="0", energy_full="1000")
    assert battery([large, small]) == Battery(75, charging=False)
    assert battery([large, cell(capacity="0")]) == Battery(50, charging=False)


def test_a_battery_that_tells_no_percents_is_worked_out_from_its_charge_or_energy() -> None:
    assert battery([cell(capacity="", charge_now="30", charge_full="40")]) == Battery(75, charging=False)
    assert battery([cell(capacity="", energy_now="30", energy_full="60")]) == Battery(50, charging=False)
    assert battery([cell(capacity="", charge_full="0", charge_now="1")]) is None


def test_a_mouse_is_not_the_nodes_battery() -> None:
    assert battery([cell(scope="Device")]) is None
    assert battery([{"type": "Mains", "online": "1"}]) is None
    assert battery([]) is None
