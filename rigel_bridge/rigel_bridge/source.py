"""From the name of a Rigelfile to the objects it stands for: the only place that reads the file and the environment."""

import hashlib
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rigel_bridge import __version__
from rigel_bridge.document.failures import BridgeError, Exit, Place
from rigel_bridge.document.tree import MAX_BYTES, Node, parse
from rigel_bridge.generations.load import Outline, completed_by, load, outline
from rigel_bridge.generations.model import Generation, Options, Rigelfile
from rigel_bridge.inferences import inferences
from rigel_bridge.render.app import Naming, Rendered, render
from rigel_bridge.render.inferred import filled

STANDARD_INPUT: Final = Path("-")


@dataclass(frozen=True, slots=True)
class Source:
    """What to read and how. `options.environment` holds the variables that the user named, and no others."""

    path: Path
    name: str | None = None
    """Name of the RobotApp; None takes the file's, else the folder's."""
    namespace: str | None = None
    today: str = ""
    """As 2026-05-22, for remarks about ends of life; empty for none."""
    options: Options = field(default_factory=Options)
    orchestration: Path | None = None
    """A second file, which completes the first."""
    profile: Path | None = None
    """Sources of the packages, from which fields are inferred that the file leaves open."""


@dataclass(frozen=True, slots=True)
class Objects:
    """The RobotApps of a Rigelfile in a fixed order, what stands beside them, and notes for the user."""

    rendered: tuple[Rendered, ...]
    rigelfile: Rigelfile
    notes: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    """Of `--profile`: which fields were inferred. They stand as comments above what is written."""

    @property
    def apps(self) -> tuple[dict[str, Any], ...]:
        return tuple(one.app for one in self.rendered)

    @property
    def claims(self) -> tuple[dict[str, Any], ...]:
        """PersistentVolumeClaims that the apps mount. They outlive the apps."""
        return tuple(claim for one in self.rendered for claim in one.claims)

    @property
    def documents(self) -> tuple[dict[str, Any], ...]:
        """Everything to be applied, in order."""
        return (*self.claims, *self.apps)


def read_bytes(path: Path) -> bytes:
    """The content of a file, or of standard input for "-", at most one byte more than allowed; BridgeError when it cannot be read."""
    try:
        if path == STANDARD_INPUT:
            return sys.stdin.buffer.read(MAX_BYTES + 1)
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise BridgeError(
            Place(str(path)), f"cannot be read: {error.strerror}{_instead(path)}", code=Exit.UNREADABLE
        ) from error


def _instead(path: Path) -> str:
    """What was probably meant by a path that is no file."""
    if path.is_dir():
        inside = path / "Rigelfile"
        return f"; give the file{f', such as {inside}' if inside.is_file() else ' in it'}"
    return "; write one, or give its path or - for standard input" if str(path) == "Rigelfile" else ""


def objects(source: Source) -> Objects:
    """Read, check and render; BridgeError for anything wrong with the file."""
    return from_bytes(read_bytes(source.path), source)


def examine(data: bytes, source: Source) -> Outline:
    """Generation, jobs, sequences and what Rigel itself would refuse."""
    return outline(parsed(data, source), source.options)


def from_bytes(data: bytes, source: Source) -> Objects:
    """The same for a file that is read already."""
    return from_root(parsed(data, source), data, source)


def read_root(source: Source) -> tuple[Node, bytes]:
    """The document of a file, and its bytes; BridgeError when it cannot be read."""
    data = read_bytes(source.path)
    return parsed(data, source), data


def from_root(root: Node, data: bytes, source: Source) -> Objects:
    """The same for a document whose bytes these are, or were before other settings were laid over it."""
    rigelfile = load(root, source.options)
    provenance = {
        "generation": str(rigelfile.generation),
        "rigelfile-sha256": _digest(data),
        "bridge-version": __version__,
        **({"orchestration-sha256": _digest(read_bytes(source.orchestration))} if source.orchestration else {}),
        **({"sequence": source.options.sequence} if source.options.sequence else {}),
    }
    found = []
    remarks: list[str] = []
    known = inferences(source.profile) if source.profile else {}
    for target in rigelfile.targets:
        own = provenance if rigelfile.generation == Generation.G1 else {**provenance, "job": target.job}
        naming = Naming(
            name=source.name or source.path.resolve().parent.name,
            override=source.name is not None,
            namespace=source.namespace,
            provenance=tuple(own.items()),
            today=source.today,
        )
        rendered = render(target, naming)
        if source.profile:
            rendered, more = filled(rendered, target, known)
            remarks += more
        found.append(rendered)
    _refuse_twins(rigelfile, found)
    notes = dict.fromkeys([*rigelfile.notes, *(note for one in found for note in one.notes)])
    return Objects(tuple(found), rigelfile, tuple(notes), tuple(dict.fromkeys(remarks)))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def parsed(data: bytes, source: Source) -> Node:
    root = parse(data, "standard input" if source.path == STANDARD_INPUT else str(source.path))
    if source.orchestration is None:
        return root
    return completed_by(root, parse(read_bytes(source.orchestration), str(source.orchestration)))


def _refuse_twins(rigelfile: Rigelfile, found: list[Rendered]) -> None:
    seen: set[str] = set()
    for target, one in zip(rigelfile.targets, found, strict=True):
        name = one.app["metadata"]["name"]
        if name in seen:
            raise target.node.fail(
                f"RobotApp {name} is rendered twice: give the jobs different names (with: {{name: …}})"
            )
        seen.add(name)
