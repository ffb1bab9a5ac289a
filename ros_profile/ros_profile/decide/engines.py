"""How units are classified: `rules` (ours) or `thesis` (the heuristic it began with, for comparison)."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from ros_profile.decide import classify, thesis
from ros_profile.decide.classify.hardware import MODULE, Devices, devices
from ros_profile.decide.units import library_unit, module_units
from ros_profile.model.conclusions import Assessment
from ros_profile.model.package import Package, Unit


@dataclass(frozen=True, slots=True)
class Engine:
    """`classify` judges one executable or package, also one of which only the name is known; `aggregate` joins the
    judgements of what runs together.
    """

    name: str
    classify: Callable[[Unit], Assessment]
    aggregate: Callable[[Sequence[Assessment]], Assessment]
    follows_launch_files: bool = True
    """A package that only launches is judged by what it starts; the thesis' heuristic looks at the package alone."""


def rules(packages: Iterable[Package], *, curated: bool) -> Engine:
    """Our rules; the packages of the workspace tell which of their libraries open devices."""
    judge = partial(classify.classify, curated=curated, libraries=_libraries(packages))
    return Engine("rules", judge, classify.aggregate)


def _libraries(packages: Iterable[Package]) -> dict[str, Devices]:
    """Devices by package, of those packages whose own code opens any, and by each of their modules of Python."""
    found: dict[str, Devices] = {}
    for package in packages:
        if opened := devices(library_unit(package)):
            found[package.name] = opened
            found |= {MODULE + name: devices(unit) for name, unit in module_units(package)}
    return found


def heuristic() -> Engine:
    """The thesis' engine."""
    return Engine("thesis", thesis.classify, thesis.aggregate, follows_launch_files=False)


def abstaining(*, curated: bool) -> Engine:
    """Concludes nothing: for reading and edges alone."""
    del curated
    return Engine("none", lambda _: Assessment(None), lambda _: Assessment(None))
