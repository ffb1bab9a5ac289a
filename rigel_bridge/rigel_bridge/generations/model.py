"""What every generation of Rigelfiles is read into: the RobotApps to be, and the sequences that lead to them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.dockerfile import ImageEnvironment


class Generation(StrEnum):
    """The formats of Rigel. G4 has G3's shape."""

    G1 = "g1"
    """PyPI 0.2: a list of packages."""
    G2A = "g2a"
    """A draft: packages as a mapping, jobs, distro at the top."""
    G2B = "g2b"
    """A draft: applications as a mapping."""
    G3 = "g3"
    """0.3 and newer: application, jobs, sequences."""
    THESIS = "thesis"
    """G3 with `orchestration` at the top, which Rigel itself refuses."""


@dataclass(frozen=True, slots=True)
class Package:
    """One component to be. `distro` and `command` are None where the user brings his own Dockerfile."""

    node: Node
    name: str
    image: str
    distro: str | None
    command: str | None
    env: ImageEnvironment
    login: str = ""
    """Server of the registry that needs a password; the password itself is never read."""
    builders: tuple[str, ...] = ()
    """Build jobs of which none could be chosen, where there is no image."""


@dataclass(frozen=True, slots=True)
class Target:
    """One RobotApp to be."""

    node: Node
    packages: tuple[Package, ...]
    orchestration: Section | None
    job: str = ""
    name: str = ""
    """Given beside the block, where an override of a sequence can reach it."""
    scheduler: str = ""
    """Chosen by a sequence; wins over the block's."""
    suffix: str = ""
    """Of one combination of a matrix; empty without one."""


@dataclass(frozen=True, slots=True)
class Step:
    """One job of a sequence. `overrides` is laid over the job's `with`, key by key; `data` is a matrix' combination."""

    job: str
    node: Node
    overrides: Node | None = None
    data: Mapping[str, Node] = field(default_factory=dict)
    combination: str = ""


@dataclass(frozen=True, slots=True)
class Rigelfile:
    """What the bridge works from. `notes` are for the user, they stop nothing."""

    node: Node
    generation: Generation
    evidence: str
    """Why it is this generation: key and line."""
    targets: tuple[Target, ...]
    jobs: tuple[str, ...] = ()
    """Ids of the jobs that deploy."""
    sequences: Mapping[str, tuple[Step, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Options:
    """How to read. `environment` holds the variables that the user named, and no others."""

    environment: Mapping[str, str] = field(default_factory=dict)
    job: str = ""
    sequence: str = ""
    image: str = ""
    """For files that name none."""
    distro: str = ""
    """For files that name none."""
