"""ROS distributions: which ROS they belong to, when support ends and which middleware they use by default."""

import difflib
from dataclasses import dataclass
from datetime import date
from typing import Final, Literal


@dataclass(frozen=True)
class Distro:
    """One distribution. `end_of_life` is the last day of support, None for the rolling one; `rmw` is empty for ROS 1.

    `released` is given only for distributions that are announced but not out.
    """

    name: str
    version: Literal[1, 2]
    end_of_life: date | None
    rmw: str
    released: date | None = None

    def is_past_end_of_life(self, today: date) -> bool:
        return self.end_of_life is not None and today > self.end_of_life


_FAST: Final = "rmw_fastrtps_cpp"

DISCOVERY_IMAGE: Final = "ros:{distro}-ros-base"
"""Image of Fast DDS discovery servers where nobody writes one."""
MASTER_IMAGE: Final = "ros:{distro}-ros-core"
"""Image of a ROS 1 master where nobody writes one."""
RECORDER_IMAGE: Final = "robotapp/recorder:{distro}"
"""Image of a recording where nobody writes one."""
IPV4: Final = "IPv4"
IPV6: Final = "IPv6"
"""The family of the first address of pods, as Kubernetes writes both."""
HELPER_USER: Final = 65532
"""User id of both where an app's components share none."""

# Where only the month of the end is published, its last day stands here: an app is warned late rather than early.
# The first five never had a published end; groovy's, which is later than all of theirs, stands for them.
_ALL: Final = (
    Distro("boxturtle", 1, date(2014, 7, 31), ""),
    Distro("cturtle", 1, date(2014, 7, 31), ""),
    Distro("diamondback", 1, date(2014, 7, 31), ""),
    Distro("electric", 1, date(2014, 7, 31), ""),
    Distro("fuerte", 1, date(2014, 7, 31), ""),
    Distro("groovy", 1, date(2014, 7, 31), ""),
    Distro("hydro", 1, date(2015, 5, 31), ""),
    Distro("indigo", 1, date(2019, 4, 30), ""),
    Distro("jade", 1, date(2017, 5, 31), ""),
    Distro("kinetic", 1, date(2021, 4, 30), ""),
    Distro("lunar", 1, date(2019, 5, 31), ""),
    Distro("melodic", 1, date(2023, 6, 30), ""),
    Distro("noetic", 1, date(2025, 5, 31), ""),
    Distro("ardent", 2, date(2018, 12, 31), _FAST),
    Distro("bouncy", 2, date(2019, 7, 31), _FAST),
    Distro("crystal", 2, date(2019, 12, 31), _FAST),
    Distro("dashing", 2, date(2021, 5, 31), _FAST),
    Distro("eloquent", 2, date(2020, 11, 30), _FAST),
    Distro("foxy", 2, date(2023, 6, 20), _FAST),
    Distro("galactic", 2, date(2022, 12, 9), "rmw_cyclonedds_cpp"),
    Distro("humble", 2, date(2027, 5, 31), _FAST),
    Distro("iron", 2, date(2024, 12, 4), _FAST),
    Distro("jazzy", 2, date(2029, 5, 31), _FAST),
    Distro("kilted", 2, date(2026, 12, 31), _FAST),
    Distro("lyrical", 2, date(2031, 5, 31), _FAST),
    Distro("makoa", 2, date(2028, 12, 31), _FAST, released=date(2027, 5, 31)),
    Distro("rolling", 2, None, _FAST),
)
DISTROS: Final = {distro.name: distro for distro in _ALL}
NO_DISTRO: Final = "none"
"""Stands in place of a distribution in an app without ROS."""
NO_ROS: Final = 0
"""ROS version of such an app."""
WITHOUT_ROS: Final = "None"
"""Value of a component's `ros` that makes it no ROS program."""


def as_data() -> list[dict[str, str | int | None]]:
    """The table for programs that cannot import this module: the bridge lives in an environment without pydantic."""
    return [
        {
            "name": distro.name,
            "version": distro.version,
            "endOfLife": distro.end_of_life.isoformat() if distro.end_of_life else None,
            "released": distro.released.isoformat() if distro.released else None,
        }
        for distro in _ALL
    ]


def ros_version(written: int | None, distro: str) -> int:
    """1 or 2: as written, else the distribution's, else 2; NO_ROS for an app without ROS."""
    if distro == NO_DISTRO:
        return NO_ROS
    known = DISTROS.get(distro)
    return written or (known.version if known else 2)


def nearest(name: str) -> str:
    """The known distribution most similar to `name`, for messages about unknown ones; empty if nothing is similar."""
    matches = difflib.get_close_matches(name.lower(), DISTROS, n=1, cutoff=0.5)
    return matches[0] if matches else ""
