"""Temperatures and batteries, from the texts of sysfs. What does not look as expected counts as not there."""

import re
from collections.abc import Iterable, Mapping
from itertools import count
from typing import Final, NamedTuple

from robotapp_agent.report.load import number
from robotapp_agent.report.readings import MOST_TEMPERATURES, Battery, Temperature

_NAME_LENGTH: Final = 60
"""Leaves room for the number that tells two sensors of one name apart."""
_UNUSUAL: Final = re.compile(r"[^A-Za-z0-9._ -]+")
_MILLIDEGREES: Final = re.compile(r"-?[0-9]{1,6}")
_COLDEST, _HOTTEST = -60, 250
"""A sensor that reports anything else is broken or not connected."""


class Sensor(NamedTuple):
    """Name and millidegrees as sysfs has them."""

    name: str
    millidegrees: str


def temperatures(zones: Iterable[Sensor], monitors: Iterable[Sensor]) -> tuple[Temperature, ...]:
    """Thermal zones and hardware monitors, in this order. A monitor of a zone's name is the same sensor once more."""
    found = [reading for sensor in zones if (reading := _temperature(sensor)) is not None]
    of_zones = {_folded(reading.name) for reading in found}
    others = [reading for sensor in monitors if (reading := _temperature(sensor)) is not None]
    found += [reading for reading in others if _folded(reading.name) not in of_zones]
    return tuple(_numbered(found[:MOST_TEMPERATURES]))


def battery(supplies: Iterable[Mapping[str, str]]) -> Battery | None:
    """All batteries of the node itself, by attributes of /sys/class/power_supply/*; a mouse's (scope Device) is not one."""
    plugged, charging = False, False
    levels: list[tuple[int, int]] = []
    for supply in supplies:
        kind = supply.get("type", "").strip()
        if kind != "Battery":
            plugged |= supply.get("online", "").strip() == "1"
        elif supply.get("scope", "").strip() != "Device" and (level := _level(supply)) is not None:
            levels.append(level)
            charging |= supply.get("status", "").strip() in ("Charging", "Full")
    if not levels:
        return None
    same_unit = all(full > 0 for _, full in levels)
    weights = [full if same_unit else 1 for _, full in levels]
    percent = sum(percent * weight for (percent, _), weight in zip(levels, weights, strict=True)) / sum(weights)
    return Battery(percent=round(percent), charging=charging or plugged)


def _level(supply: Mapping[str, str]) -> tuple[int, int] | None:
    """(percent, capacity when full); 0 when the battery does not tell the latter in energy."""
    full, now = number(supply.get("energy_full", "")), number(supply.get("energy_now", ""))
    percent = number(supply.get("capacity", ""))
    if percent is None:
        full_charge, charge = number(supply.get("charge_full", "")), number(supply.get("charge_now", ""))
        held, most = (now, full) if full else (charge, full_charge)
        percent = round(100 * held / most) if most and held is not None else None
    return None if percent is None else (min(percent, 100), full or 0)


def _temperature(sensor: Sensor) -> Temperature | None:
    text, name = sensor.millidegrees.strip(), _UNUSUAL.sub("-", sensor.name.strip())[:_NAME_LENGTH].strip(" -")
    if not name or not _MILLIDEGREES.fullmatch(text):
        return None
    celsius = round(int(text) / 1000)
    return Temperature(name, celsius) if _COLDEST <= celsius <= _HOTTEST else None


def _folded(name: str) -> str:
    """The kernel names a zone's monitor like the zone, with `_` for `-`."""
    return name.replace("-", "_")


def _numbered(readings: Iterable[Temperature]) -> Iterable[Temperature]:
    seen: set[str] = set()
    for name, celsius in readings:
        names = (name if number == 1 else f"{name}-{number}" for number in count(1))
        free = next(each for each in names if each not in seen)
        seen.add(free)
        yield Temperature(free, celsius)
