"""Which launch file of a workspace becomes a RobotApp, and for which ROS distribution."""

import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Final

from ros_profile.model.conclusions import LaunchProfile, Profile
from ros_profile.model.facts import NOT_HERE
from ros_profile.output.names import ROS1_DISTROS
from ros_profile.output.processes import components

MOST_NAMED: Final = 20


class ChoiceError(Exception):
    """No launch file, or no distribution, can be chosen: one sentence with what there is."""

    def __init__(self, message: str, *, is_usage: bool) -> None:
        """is_usage: another call would work; else the workspace has nothing to make an app of."""
        super().__init__(message)
        self.is_usage = is_usage


def choose_launch(profile: Profile, wanted: str, *, option: str) -> LaunchProfile:
    """Returns the launch file that is named, or the only one that starts more than viewers. Raises ChoiceError.

    `wanted`: its name, path, or package/path; "" for none. `option`: where the user writes it.
    """
    everything = [launch for package in profile.packages for launch in package.launches]
    usable = [launch for launch in everything if components(launch.nodes)]
    fitting = [launch for launch in everything if wanted and _is_named(launch, wanted)]
    launches = [launch for launch in usable if launch in fitting] if wanted else usable
    if len(launches) == 1:
        return launches[0]
    names = _list_names(launches or usable)
    if launches:
        raise ChoiceError(f"a RobotApp is made of one launch file; name it with {option}: {names}", is_usage=True)
    if fitting:
        reason = _explain_empty(fitting[0])
        rest = f"; others: {names}" if names else ""
        text = f"{name_launch(fitting[0])} starts no node that belongs on a robot{reason}{rest}"
        raise ChoiceError(text, is_usage=False)
    if wanted and usable:
        text = f"{option} {wanted}: there is no such launch file{_find_near(wanted, usable)}; there are: {names}"
        raise ChoiceError(text, is_usage=False)
    count = f"none of {len(everything)} starts a node that belongs on a robot" if everything else "there is none"
    raise ChoiceError(f"{profile.path}: a RobotApp is made of a launch file, and {count}", is_usage=False)


def choose_distro(profile: Profile, launch: LaunchProfile, wanted: str) -> str:
    """Returns the distribution as wanted, else noetic or jazzy by the package's ROS version. Raises ChoiceError."""
    package = next(package for package in profile.packages if package.name == launch.package)
    distro = wanted or ("noetic" if package.ros_version == 1 else "jazzy")
    if not re.fullmatch("[a-z]{1,32}", distro):
        text = f"--distro {distro[:40]!r} is no distribution; allowed: lower-case letters, such as jazzy"
        raise ChoiceError(text, is_usage=True)
    if package.ros_version and (package.ros_version == 1) != (distro in ROS1_DISTROS):
        text = f"--distro {distro} is not one of ROS {package.ros_version}, for which {package.name} is"
        raise ChoiceError(text, is_usage=True)
    return distro


def name_launch(launch: LaunchProfile) -> str:
    """Returns `package/path`."""
    return f"{launch.package}/{launch.file}"


def _list_names(launches: Sequence[LaunchProfile]) -> str:
    more = f" and {len(launches) - MOST_NAMED} more" if len(launches) > MOST_NAMED else ""
    return ", ".join(name_launch(launch) for launch in launches[:MOST_NAMED]) + more


def _explain_empty(launch: LaunchProfile) -> str:
    """Returns what of a launch file without nodes was not followed, or nothing."""
    absent = "; ".join(one.message for one in launch.problems if one.message.endswith(NOT_HERE))
    if absent:
        return f": it {absent[:500]}; put its source beside it"
    unread = "; ".join(one.message for one in launch.problems)
    return f" as far as it can be followed: {unread[:500]}" if unread else ""


def _find_near(wanted: str, launches: Sequence[LaunchProfile]) -> str:
    """Returns ` (did you mean X?)` or nothing."""
    names = {name_launch(launch).rpartition("/")[2]: name_launch(launch) for launch in launches}
    near = get_close_matches(wanted.rpartition("/")[2], names, n=1)
    return f" (did you mean {names[near[0]]}?)" if near else ""


def _is_named(launch: LaunchProfile, wanted: str) -> bool:
    return f"/{name_launch(launch)}".endswith(f"/{wanted}") or _is_short(launch, wanted)


def _is_short(launch: LaunchProfile, wanted: str) -> bool:
    """Whether it is `package/name` without the folder between them."""
    package, _, name = wanted.partition("/")
    return package == launch.package and launch.file.rpartition("/")[2] == name
