"""The file of results: a line of JSON for its header, for each session, and for each deployment. Reading and writing lines is pure."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from campaigns.teleop.design import Arm, Condition, Turn
from campaigns.teleop.metrics import Figures

PROTOCOL: Final = "docs/evaluation/eo2-protocol.md"


class RecordError(ValueError):
    """A file of results cannot be used; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Header:
    seed: int
    rounds: int
    pilot: bool
    protocol: str = PROTOCOL


@dataclass(frozen=True, slots=True)
class Session:
    """One start of the runner. `loaded`: others used the machine, and the runner was told to start anyway."""

    began_at: str
    commit: str
    machine: str
    loaded: bool
    load_average: float


@dataclass(frozen=True, slots=True)
class Load:
    """The machine during a window: load average of one minute, and shares of its CPU time."""

    average: float
    busy_share: float
    steal_share: float


@dataclass(frozen=True, slots=True)
class Deployment:
    """One deployment as it went. A void one has a reason and is repeated; `trips_ms` are those of the window.

    `restarts` counts those of all containers: a program that is started anew begins its file anew.
    """

    turn: Turn
    session: int
    """Number of the session that made it, from 1."""
    began_at: str
    node: str = ""
    helpers: dict[str, str] = field(default_factory=dict)
    restarts: int = 0
    figures: Figures | None = None
    load: Load | None = None
    trips_ms: tuple[float | None, ...] = ()
    void: str = ""


@dataclass(frozen=True, slots=True)
class Results:
    header: Header
    sessions: tuple[Session, ...] = ()
    deployments: tuple[Deployment, ...] = ()

    @property
    def valid(self) -> list[Deployment]:
        """The deployments that count, one per turn."""
        return [deployment for deployment in self.deployments if not deployment.void]

    def list_pending(self, turns: Iterable[Turn]) -> list[Turn]:
        """Returns the turns that have no valid deployment yet, in their order."""
        ended_numbers = {deployment.turn.number for deployment in self.valid}
        return [turn for turn in turns if turn.number not in ended_numbers]

    def count_void(self, turn: Turn) -> int:
        return sum(bool(entry.void) and entry.turn.number == turn.number for entry in self.deployments)


def to_line(entry: Header | Session | Deployment) -> str:
    """Returns an entry as one line of JSON, which names its kind."""
    return json.dumps({type(entry).__name__.lower(): asdict(entry)}) + "\n"


def read(lines: Sequence[str], *, name: str = "the file") -> Results:
    """Reads a file of results. A last line without its end was being written when the runner was killed: it is left out."""
    complete = [line for line in lines if line.endswith("\n") and line.strip()]
    results: Results | None = None
    for number, line in enumerate(complete, start=1):
        try:
            ((kind, fields),) = json.loads(line).items()
            results = _add(results, kind, fields)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise RecordError(
                f"{name}, line {number} is no line of this bench ({error}): name another file, or remove it"
            ) from None
    if results is None:
        raise RecordError(f"{name} has no header: remove it, and start without --resume")
    return results


def read_file(path: Path) -> Results:
    if not path.exists():
        raise RecordError(f"there is no file {path}")
    return read(path.read_text().splitlines(keepends=True), name=str(path))


def _add(results: Results | None, kind: str, fields: dict[str, Any]) -> Results:
    if kind == "header":
        if results is not None:
            raise ValueError("a second header")
        return Results(Header(**fields))
    if results is None:
        raise ValueError("the first line must be the header")
    if kind == "session":
        return replace(results, sessions=(*results.sessions, Session(**fields)))
    if kind == "deployment":
        return replace(results, deployments=(*results.deployments, _to_deployment(fields)))
    raise ValueError(f"unknown kind {kind!r}")


def _to_deployment(fields: dict[str, Any]) -> Deployment:
    turn = fields["turn"]
    structs = {
        "turn": Turn(turn["number"], turn["block"], Condition(**turn["condition"]), Arm(turn["arm"])),
        "figures": Figures(**fields["figures"]) if fields["figures"] else None,
        "load": Load(**fields["load"]) if fields["load"] else None,
        "trips_ms": tuple(fields["trips_ms"]),
    }
    return Deployment(**{**fields, **structs})


class Journal:
    """The file to which a run appends its lines as they come."""

    def __init__(self, path: Path, results: Results) -> None:
        self.path = path
        self.results = results

    @classmethod
    def open(cls, path: Path, header: Header, *, resume: bool) -> "Journal":
        """Begins a file, or goes on with one of the same header."""
        text = path.read_text() if path.exists() else ""
        if not text:
            path.write_text(to_line(header))
            return cls(path, Results(header))
        if not resume:
            raise RecordError(f"{path} has results: go on with --resume, or name another file")
        results = read_file(path)
        if results.header != header:
            raise RecordError(
                f"{path} was begun as {results.header}, not {header}: resume with its own options, or name another file"
            )
        if not text.endswith("\n"):
            path.write_text(text[: text.rfind("\n") + 1])
        return cls(path, results)

    def append(self, entry: Session | Deployment) -> None:
        with self.path.open("a") as file:
            file.write(to_line(entry))
        if isinstance(entry, Session):
            self.results = replace(self.results, sessions=(*self.results.sessions, entry))
        else:
            self.results = replace(self.results, deployments=(*self.results.deployments, entry))
