"""`generate_profile`: a folder in, a profile out. The one door for programs; `main` is the one for people."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from ros_profile.decide.engines import Engine, abstaining, heuristic, rules
from ros_profile.decide.profiling import profile
from ros_profile.files.cache import LastProfile
from ros_profile.files.load import Progress, load
from ros_profile.model.conclusions import Profile
from ros_profile.model.package import Package

ENGINES: Final = ("rules", "thesis", "none")


def generate_profile(
    path: str | os.PathLike[str],
    *,
    engine: str = "rules",
    curated: bool = True,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Profile:
    """The profile of a package or of a workspace with several, ROS 1 or ROS 2.

    `curated=False` leaves out the table of well-known packages. `cache` is a folder for what was read, by content.
    OSError when `path` is no folder that can be read; whatever stands in its files is no error but a `Problem`.
    """
    workspace = load(Path(path), progress, cache=cache)
    last = LastProfile(cache, os.fspath(path), os.fspath(Path.cwd()), engine, str(curated))
    if workspace.digest and (known := last.get(workspace.digest)):
        return known
    made = profile(
        workspace.packages,
        engine_named(engine, workspace.packages, curated=curated),
        path=os.fspath(path),
        curated=curated,
        problems=workspace.problems,
    )
    if workspace.digest:
        last.put(workspace.digest, made)
    return made


def engine_named(name: str, packages: Iterable[Package], *, curated: bool = True) -> Engine:
    """The engine of that name for these packages. ValueError for any other name."""
    if name == "rules":
        return rules(packages, curated=curated)
    if name == "thesis":
        return heuristic()
    if name == "none":
        return abstaining(curated=curated)
    raise ValueError(f"no engine {name!r}; there are {', '.join(ENGINES)}")
