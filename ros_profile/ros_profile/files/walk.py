"""Packages of a folder and their files, within bounds: never outside the folder, never what is no regular file."""

import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ros_profile.model.facts import Problem

MAX_FILE_BYTES: Final = 2 << 20
MAX_FILES: Final = 4000
"""Of one package; of a workspace MAX_PACKAGES times as many would be possible, so its bytes are bounded as well."""
MAX_PACKAGES: Final = 2000
MAX_FOLDERS: Final = 20_000
MAX_DEPTH: Final = 20
MAX_PACKAGE_BYTES: Final = 64 << 20
IGNORE_MARKERS: Final = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")
_NOT_SOURCE: Final = frozenset({"test", "tests", "testing", "doc", "docs", "__pycache__", "node_modules"})
_VENDORED: Final = frozenset({"third_party", "thirdparty", "3rdparty", "3rd_party", "vendor", "external", "extern"})
_BUILT: Final = frozenset({"build", "install", "log", "devel"})
_SUFFIXES: Final = (
    *(".py", ".cpp", ".cc", ".cxx", ".c", ".hpp", ".h", ".hh", ".hxx", ".cu", ".cuh", ".inl", ".ipp"),
    *(
        ".launch",
        ".xml",
        ".yaml",
        ".yml",
        ".xacro",
        ".urdf",
        ".rules",
        ".msg",
        ".srv",
        ".action",
        ".cmake",
        ".cfg",
        ".toml",
    ),
    *("cmakelists.txt", ".rosinstall"),
)
_SCRIPT_FOLDERS: Final = frozenset({"scripts", "nodes", "bin", "script", "src", "node"})


@dataclass(frozen=True, slots=True)
class Found:
    """A package's folder. `relative` is its path below what was given, `.` for that itself."""

    folder: Path
    relative: str


def packages(root: Path) -> tuple[list[Found], list[Problem]]:
    """Folders with a package.xml, sorted; below one, no other is looked for (as colcon and catkin do)."""
    found: list[Found] = []
    problems: list[Problem] = []
    waiting = [(root, 0)]
    seen = 0
    while waiting and len(found) < MAX_PACKAGES:
        folder, depth = waiting.pop()
        seen += 1
        if seen > MAX_FOLDERS:
            problems.append(Problem(".", f"has more than {MAX_FOLDERS} folders; the rest is not searched"))
            break
        entries = _entries(folder, problems, root)
        names = {entry.name for entry in entries}
        if "package.xml" in names:
            found.append(Found(folder, folder.relative_to(root).as_posix()))
            continue
        if depth and not names.isdisjoint(IGNORE_MARKERS):
            continue
        if depth < MAX_DEPTH:
            below = [e for e in entries if e.is_dir(follow_symlinks=False) and not e.name.startswith(".")]
            waiting += [(folder / e.name, depth + 1) for e in below if depth or e.name not in _BUILT]
    if len(found) >= MAX_PACKAGES:
        problems.append(Problem(".", f"has more than {MAX_PACKAGES} packages; the rest is not read"))
    return sorted(found, key=lambda f: f.relative), problems


def _entries(folder: Path, problems: list[Problem], root: Path) -> list["os.DirEntry[str]"]:
    try:
        with os.scandir(folder) as listing:
            return sorted((entry for entry in listing if _is_text(entry.name)), key=lambda entry: entry.name)
    except OSError as error:
        problems.append(Problem(folder.relative_to(root).as_posix(), f"cannot be listed: {error.strerror}"))
        return []


def _is_text(name: str) -> bool:
    """Names in no encoding cannot be written into a profile; no tool of ROS makes them."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return name.isprintable()


def files(package: Path, problems: list[Problem]) -> Iterator[str]:
    """Paths of the files worth reading, relative to the package, in order. Folders behind links are not entered."""
    waiting = [(package, 0)]
    count = folders = 0
    while waiting:
        folder, depth = waiting.pop()
        folders += 1
        if folders > MAX_FILES:
            problems.append(Problem(".", f"has more than {MAX_FILES} folders; the rest is not read"))
            return
        entries = _entries(folder, problems, package)
        if depth and not {entry.name for entry in entries}.isdisjoint((*IGNORE_MARKERS, "package.xml")):
            continue
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                if depth < MAX_DEPTH and _is_source_folder(entry.name):
                    waiting.append((folder / entry.name, depth + 1))
            elif _is_worth_reading(entry.name, folder.name) and not _leads_to_folder(entry):
                count += 1
                if count > MAX_FILES:
                    problems.append(Problem(".", f"has more than {MAX_FILES} files; the rest is not read"))
                    return
                yield (folder / entry.name).relative_to(package).as_posix()


def _leads_to_folder(entry: "os.DirEntry[str]") -> bool:
    try:
        return entry.is_dir()
    except OSError:  # a link to itself
        return False


def _is_source_folder(name: str) -> bool:
    low = name.lower()
    return not low.startswith(".") and low not in _NOT_SOURCE and low not in _VENDORED


def _is_worth_reading(name: str, folder: str) -> bool:
    low = name.lower()
    if low.startswith((".", "test_")) or low.endswith(("_test.py", "_test.cpp", "_test.cc")):
        return False
    return low.endswith(_SUFFIXES) or ("." not in low and folder in _SCRIPT_FOLDERS)


def read(package: Path, file: str, *, most: int = MAX_FILE_BYTES) -> bytes | Problem:
    """The bytes of a file of the package, or why not. A link is followed when it ends inside the package."""
    path = package / file
    try:
        if path.is_symlink():
            target = Path(os.path.realpath(path))
            if not target.is_relative_to(os.path.realpath(package)):
                return Problem(file, "is a link out of the package; it is not followed")
            path = target
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                return Problem(file, "is no regular file")
            if status.st_size > most:
                return Problem(file, f"has {status.st_size} bytes; at most {most} are read")
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        return Problem(file, f"cannot be read: {getattr(error, 'strerror', None) or error}")
    return data if len(data) <= most else Problem(file, f"has more than {most} bytes; it is not read")
