"""From the name of a Rigelfile to the objects it stands for: the only place that reads the file and the environment."""

import hashlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rigel_bridge import __version__
from rigel_bridge.document.failures import BridgeError, Exit, Place
from rigel_bridge.document.tree import MAX_BYTES, parse
from rigel_bridge.generations.g1 import load
from rigel_bridge.render.app import render

STANDARD_INPUT: Final = Path("-")


@dataclass(frozen=True, slots=True)
class Source:
    """What to read and how. `environment` holds the variables that the user named, and no others."""

    path: Path
    name: str | None = None
    """Name of the RobotApp; None takes the file's, else the folder's."""
    namespace: str | None = None
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Objects:
    """The RobotApps of a Rigelfile in a fixed order, and what the user should be told about them."""

    apps: tuple[dict[str, Any], ...]
    notes: tuple[str, ...]


def read_bytes(path: Path) -> bytes:
    """The content of a file, or of standard input for "-", at most one byte more than allowed; BridgeError when it cannot be read."""
    try:
        if path == STANDARD_INPUT:
            return sys.stdin.buffer.read(MAX_BYTES + 1)
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise BridgeError(Place(str(path)), f"cannot be read: {error.strerror}", code=Exit.UNREADABLE) from error


def objects(source: Source) -> Objects:
    """Read, check and render; BridgeError for anything wrong with the file."""
    data = read_bytes(source.path)
    shown = "standard input" if source.path == STANDARD_INPUT else str(source.path)
    rigelfile = load(parse(data, shown), source.environment)
    rendered = render(
        rigelfile,
        name=source.name or source.path.resolve().parent.name,
        override=source.name is not None,
        namespace=source.namespace,
        provenance={
            "generation": "g1",
            "rigelfile-sha256": hashlib.sha256(data).hexdigest(),
            "bridge-version": __version__,
        },
    )
    return Objects((rendered.app,), rendered.notes)
