"""A folder to packages: finds them, reads their files, hands the bytes to the readers."""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ros_profile.decide.executables import executables
from ros_profile.files import walk
from ros_profile.files.cache import Entry, Shelf, code_version, key_of
from ros_profile.model.facts import Problem
from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import Manifest, Package, SourceFile
from ros_profile.read.dispatch import launch_reader_of, reader_of
from ros_profile.read.manifest import MAX_BYTES as MAX_MANIFEST_BYTES
from ros_profile.read.manifest import read_manifest

Progress = Callable[[int, int, str], None]
"""Called with packages done, packages in all, and the name of the package that is read next."""


@dataclass(frozen=True, slots=True)
class Workspace:
    packages: tuple[Package, ...]
    problems: tuple[Problem, ...] = ()
    digest: str = ""
    """Of everything that was read, and of the code that read it; empty without a cache."""


def load(root: Path, progress: Progress | None = None, *, cache: Path | None = None) -> Workspace:
    """Every package at or below `root`. What cannot be read is a problem; OSError only when `root` is no folder."""
    root = Path(os.path.realpath(root, strict=True))
    if not root.is_dir():
        raise NotADirectoryError(20, "is no folder; give that of a package or of a workspace", str(root))
    found, problems = walk.packages(root)
    version = code_version() if cache else ""
    packages: list[Package] = []
    digest = hashlib.blake2b(version.encode(), digest_size=16)
    for index, one in enumerate(found):
        if progress:
            progress(index, len(found), one.relative)
        shelf = Shelf(cache, str(one.folder), version)
        package, trouble = load_package(one, shelf)
        digest.update(shelf.digest.digest())
        problems += trouble
        if package is not None:
            packages.append(package)
    digest.update(repr([problems, [(one.path, one.manifest, one.problems) for one in packages]]).encode())
    return Workspace(tuple(packages), tuple(problems), digest.hexdigest() if cache else "")


def load_package(found: walk.Found, shelf: Shelf) -> tuple[Package | None, list[Problem]]:
    """One package; None with the problem when its manifest gives no name."""
    manifest, problems = _manifest(found)
    if manifest is None:
        return None, [Problem(f"{found.relative}/{p.file}", p.message, p.line) for p in problems]
    sources: list[SourceFile] = []
    launch_files: list[LaunchFile] = []
    left = walk.MAX_PACKAGE_BYTES
    for file in walk.files(found.folder, problems):
        data = walk.read(found.folder, file)
        if isinstance(data, Problem):
            problems.append(data)
            continue
        left -= len(data)
        if left < 0:
            problems.append(
                Problem(".", f"has more than {walk.MAX_PACKAGE_BYTES} bytes of source; the rest is not read")
            )
            break
        entry = _entry(file, data, shelf)
        if entry.launch is not None:
            launch_files.append(entry.launch)
        if entry.source is not None:
            sources.append(entry.source)
    shelf.save()
    problems += [p for source in sources for p in source.problems]
    problems += [p for launch in launch_files for p in launch.problems]
    sources.sort(key=lambda source: source.file)
    launch_files.sort(key=lambda launch: launch.file)
    return Package(
        manifest=manifest,
        path=found.relative,
        sources=tuple(sources),
        executables=executables(sources),
        launch_files=tuple(launch_files),
        problems=tuple(problems),
    ), []


def _entry(file: str, data: bytes, shelf: Shelf) -> Entry:
    """What a file holds, from the cache when its bytes were read before."""
    key = key_of(file, data)
    entry = shelf.get(key)
    if entry is None:
        if launch_reader := launch_reader_of(file, data):
            entry = Entry(launch=launch_reader(data, file))
        elif reader := reader_of(file, data[:200]):
            entry = Entry(source=reader(data, file))
        else:
            entry = Entry()
        shelf.put(key, entry)
    return entry


def _manifest(found: walk.Found) -> tuple[Manifest | None, list[Problem]]:
    data = walk.read(found.folder, "package.xml", most=MAX_MANIFEST_BYTES)
    if isinstance(data, Problem):
        return None, [data]
    manifest, problems = read_manifest(data)
    return manifest, list(problems)
