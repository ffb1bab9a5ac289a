"""ROS distributions: which ROS they belong to, when support ends and which middleware they use by default."""

import difflib
from dataclasses import dataclass
from datetime import date
from typing import Final, Literal


@dataclass(frozen=True)
class Distro:
    """One distribution. `end_of_life` is the last day of support, None for the rolling one; `rmw` is empty for ROS 1."""

    name: str
    version: Literal[1, 2]
    end_of_life: date | None
    rmw: str

    def is_past_end_of_life(self, today: date) -> bool:
        return self.end_of_life is not None and today > self.end_of_life


_FAST: Final = "rmw_fastrtps_cpp"

# Where only the month of the end is published, its last day stands here: an app is warned late rather than early.
_ALL: Final = (
    Distro("kinetic", 1, date(2021, 4, 30), ""),
    Distro("melodic", 1, date(2023, 6, 30), ""),
    Distro("noetic", 1, date(2025, 5, 31), ""),
    Distro("foxy", 2, date(2023, 6, 20), _FAST),
    Distro("galactic", 2, date(2022, 12, 9), "rmw_cyclonedds_cpp"),
    Distro("humble", 2, date(2027, 5, 31), _FAST),
    Distro("iron", 2, date(2024, 12, 4), _FAST),
    Distro("jazzy", 2, date(2029, 5, 31), _FAST),
    Distro("kilted", 2, date(2026, 12, 31), _FAST),
    Distro("lyrical", 2, date(2031, 5, 31), _FAST),
    Distro("rolling", 2, None, _FAST),
)
DISTROS: Final = {distro.name: distro for distro in _ALL}


def ros_version(written: int | None, distro: str) -> int:
    """1 or 2: as written, else the distribution's, else 2."""
    known = DISTROS.get(distro)
    return written or (known.version if known else 2)


def nearest(name: str) -> str:
    """The known distribution most similar to `name`, for messages about unknown ones; empty if nothing is similar."""
    matches = difflib.get_close_matches(name.lower(), DISTROS, n=1, cutoff=0.5)
    return matches[0] if matches else ""
