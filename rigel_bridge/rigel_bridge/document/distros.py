"""ROS distributions: the operator's own table, shipped as data."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any


@dataclass(frozen=True, slots=True)
class Distro:
    """One distribution. Days are written 2026-05-22, so that texts compare as days do; empty where there is none."""

    name: str
    version: int
    """1 or 2."""
    end_of_life: str
    released: str
    """Only of distributions that are announced but not out."""


@cache
def distros() -> dict[str, Distro]:
    """All known distributions by name, oldest first."""
    text = files("rigel_bridge").joinpath("data/distros.json").read_text(encoding="utf-8")
    return {
        entry["name"]: Distro(entry["name"], entry["version"], entry["endOfLife"] or "", entry["released"] or "")
        for entry in json.loads(text)
    }


def ros_version(spec: Mapping[str, Any]) -> int:
    """1 or 2, of a RobotApp's spec: as it is stated there, else of its distribution. A distribution that is not known is ROS 2's."""
    ros = spec.get("ros", {})
    known = distros().get(ros.get("distro", ""))
    return int(ros.get("version") or (known.version if known else 2))


def remark(distro: Distro, today: str) -> str:
    """What a user should know about a distribution on a day; empty for a supported one."""
    if distro.end_of_life and distro.end_of_life < today:
        return f"{distro.name} had its end of life on {distro.end_of_life}: its packages and images get no fixes"
    if distro.released and today < distro.released:
        return f"{distro.name} is not released yet (announced for {distro.released})"
    return ""
