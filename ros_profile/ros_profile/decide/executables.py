"""The executables of a package: what its build files declare, and scripts that can be started by their file name."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from ros_profile.model.package import Executable, SourceFile

_SCRIPT_FOLDERS = ("scripts/", "nodes/", "bin/", "script/", "node/")


def executables(sources: Iterable[SourceFile]) -> tuple[Executable, ...]:
    """Each once, with the names of files as they are in the package, sorted by name."""
    kept = list(sources)
    present = frozenset(source.file for source in kept)
    declared = [_located(e, present) for s in kept if s.language != "python" for e in s.executables]
    covered = {file for executable in declared for file in executable.files}
    scripts = [e for s in kept if s.language == "python" for e in s.executables if _is_started(s, covered)]
    found: dict[tuple[str, str], Executable] = {}
    for executable in (*declared, *scripts):
        key = (executable.plugin or executable.name, executable.kind)
        found[key] = _joined(found[key], executable) if key in found else executable
    return tuple(sorted(found.values(), key=lambda e: (e.name, e.kind, e.plugin)))


def _is_started(source: SourceFile, covered: set[str]) -> bool:
    return source.file not in covered and (source.file.startswith(_SCRIPT_FOLDERS) or bool(source.node_names))


def _joined(first: Executable, second: Executable) -> Executable:
    return replace(first, files=tuple(dict.fromkeys(first.files + second.files)), plugin=first.plugin or second.plugin)


def _located(executable: Executable, present: frozenset[str]) -> Executable:
    return replace(
        executable, files=tuple(dict.fromkeys(f for name in executable.files for f in _existing(name, present)))
    )


def _existing(name: str, present: frozenset[str]) -> Iterator[str]:
    """`pkg/node.py` may lie in src/, and the module may be a package."""
    for candidate in (
        name,
        f"src/{name}",
        f"{name.removesuffix('.py')}/__init__.py",
        f"src/{name.removesuffix('.py')}/__init__.py",
    ):
        if candidate in present:
            yield candidate
            return
