"""Run one sequence: its jobs, the app, its results. The app is removed at the end, however the run ends."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.deployment import deploy
from rigel_bridge.cluster.instances import instances_of
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl
from rigel_bridge.cluster.removal import remove
from rigel_bridge.cluster.results import APP, FILES, Collection, collect
from rigel_bridge.cluster.volume_claims import apply_claims
from rigel_bridge.cluster.waiting import Clock, wait_ready
from rigel_bridge.document.failures import BridgeError
from rigel_bridge.names import PROVENANCE
from rigel_bridge.sequences.comparison import is_summary
from rigel_bridge.sequences.samples import columns, edges, placement
from rigel_bridge.sequences.steps import Action, Kind, run_name
from rigel_bridge.source import Objects

RUN: Final = f"{PROVENANCE}run"
"""On the app of a run: the sequence. Such an app may be removed by the next run; one without it is somebody's."""
RUN_ID: Final = f"{PROVENANCE}run-id"
"""Which run of the sequence the app is of: two people may run the same one, under the same names, at the same time."""

_SHOWN_S: Final = 10.0
_SUMMARY: Final = "summary.json"
_MAX_SUMMARY_BYTES: Final = 16 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Limits:
    """Times of a run in seconds."""

    ready_s: float = 120.0
    duration_s: float = 30.0
    """How long the app works between Ready and the collection of its results."""
    removal_s: float = 120.0


@dataclass(frozen=True, slots=True)
class Tools:
    """What a run acts with. `rigel` runs Rigel's own commands."""

    kubectl: Kubectl
    rigel: Callable[[Sequence[str]], None]
    tell: Callable[[str], None]
    clock: Clock
    limits: Limits
    keep: bool = False
    """Leave the app in the cluster."""
    run_id: str = ""
    """Different for each call."""


@dataclass(slots=True)
class Outcome:
    """One app of a run. Its summary is complete only after a run without errors."""

    sequence: str
    summary: dict[str, Any] = field(default_factory=dict)


def run(sequence: str, steps: Sequence[Action], objects: Objects, tools: Tools, into: Collection) -> list[Outcome]:
    """All steps in order, results in `into`. Errors pass through after results were collected and the apps removed."""
    found: list[Outcome] = []
    wanted = [renamed(app, sequence, run_id=tools.run_id) for app in objects.apps]
    with _removed_at_the_end(wanted, tools):
        for step in steps:
            tools.tell(f"{sequence}: {step.job}")
            if step.note:
                tools.tell(f"note: {step.note}")
            if step.kind is Kind.RIGEL:
                for command in step.commands:
                    tools.rigel(command)
            else:
                apply_claims(tools.kubectl, objects.claims)
                found += _deployed(sequence, wanted, tools, into)
    return found


def renamed(app: Mapping[str, Any], sequence: str, *, run_id: str = "") -> dict[str, Any]:
    """The app under the name of its run."""
    metadata = app["metadata"]
    annotations = {**metadata.get("annotations", {}), RUN: sequence, RUN_ID: run_id}
    return {**app, "metadata": {**metadata, "name": run_name(metadata["name"], sequence), "annotations": annotations}}


@contextmanager
def _removed_at_the_end(wanted: Sequence[Mapping[str, Any]], tools: Tools) -> Iterator[None]:
    """Refuse names that are in use, and clear what an earlier run left that was killed."""
    names = [app["metadata"]["name"] for app in wanted]
    for name in names:
        present = apps.read(tools.kubectl, name)
        if present is None:
            continue
        if RUN not in (present["metadata"].get("annotations") or {}):
            raise ClusterError(
                f"RobotApp {name} is there and of no earlier run: a run would replace and delete it; choose another --name"
            )
        tools.tell(f"{name}: of an earlier run, removed")
        remove(tools.kubectl, name, timeout_s=tools.limits.removal_s, clock=tools.clock)
    try:
        yield
    finally:
        for name in names if not tools.keep else ():
            present = apps.read(tools.kubectl, name)
            if present is not None and not _is_own(present, tools):
                tools.tell(f"{name}: is of another run by now, and stays")
                continue
            tools.tell(f"{name}: removed")
            remove(tools.kubectl, name, timeout_s=tools.limits.removal_s, clock=tools.clock)


def _is_own(app: Mapping[str, Any], tools: Tools) -> bool:
    annotations: Mapping[str, str] = app["metadata"].get("annotations") or {}
    return annotations.get(RUN_ID, "") == tools.run_id


def _require_own(name: str, tools: Tools) -> None:
    """ClusterError when another run has taken the place of this one: its figures are not ours."""
    if not _is_own(apps.existing(tools.kubectl, name), tools):
        raise ClusterError(
            f"RobotApp {name} is of another run by now: run one sequence at a time, or choose another --name"
        )


def _deployed(sequence: str, wanted: Sequence[Mapping[str, Any]], tools: Tools, into: Collection) -> list[Outcome]:
    """Bring all apps in, let them work, collect. Results are collected also of an app that does not become Ready."""
    begun_s = tools.clock.now_s()
    outcomes = [
        Outcome(sequence, {"sequence": sequence, "app": app["metadata"]["name"], "outcome": "failed"}) for app in wanted
    ]
    try:
        for app in wanted:
            deploy(tools.kubectl, app, tell=tools.tell)
        for outcome in outcomes:
            name = outcome.summary["app"]
            wait_ready(tools.kubectl, name, timeout_s=tools.limits.ready_s, clock=tools.clock, tell=tools.tell)
            outcome.summary["ready_after_s"] = tools.clock.now_s() - begun_s
            _settled(name, tools)
        tools.tell(f"{sequence}: Ready, working for {tools.limits.duration_s:g} s")
        tools.clock.sleep(tools.limits.duration_s)
        for outcome in outcomes:
            _require_own(outcome.summary["app"], tools)
        for outcome in outcomes:
            outcome.summary["outcome"] = "ran"
    finally:
        for outcome in outcomes:
            _collected(outcome, tools, into, alone=len(outcomes) == 1)
    return outcomes


def _settled(name: str, tools: Tools) -> None:
    """Wait until the instances show where components run: they are written after the app's own status."""
    app = apps.existing(tools.kubectl, name)

    def shown() -> bool:
        found = placement(instances_of(tools.kubectl, app))
        return bool(found) and all(each["ready"] for each in found)

    if not tools.clock.until(shown, timeout_s=_SHOWN_S):
        tools.tell(f"{name}: no instance shows its components yet, so the summary has no nodes")


def _collected(outcome: Outcome, tools: Tools, into: Collection, *, alone: bool) -> None:
    """A failing collection hides no earlier failure: it is told, and the run goes on to its end."""
    name = outcome.summary["app"]
    own = Collection(into.folder if alone else into.folder / name)
    try:
        app = apps.read(tools.kubectl, name)
        if app is None or not _is_own(app, tools):
            return
        collect(tools.kubectl, app, own, tell=tools.tell)
        instances = instances_of(tools.kubectl, app)
        outcome.summary |= {
            "scheduler": app["spec"].get("schedulerName", "the operator's"),
            "domain": app.get("status", {}).get("summary", {}).get("domain"),
            "components": placement(instances),
            "edges": edges(instances),
            "samples": _samples(own.folder / FILES),
        }
        own.add_json(_SUMMARY, outcome.summary)
        own.close()
    except BridgeError as error:
        tools.tell(f"results of {name}: {error}")


def _samples(folder: Path) -> dict[str, dict[str, float]]:
    """Statistics by `file column`, of every CSV file that was collected."""
    found = {}
    for path in sorted(path for path in folder.rglob("*.csv") if path.is_file()):
        for column, figures in columns(path.read_bytes()).items():
            found[f"{path.relative_to(folder)} {column}"] = figures
    return found


def read_summaries(folder: Path) -> list[dict[str, Any]]:
    """The summaries below a folder, by path; a file that is none is passed over, and so is what a container left."""
    found = []
    for path in sorted(folder.rglob(_SUMMARY)):
        if _is_of_container(path.relative_to(folder), folder):
            continue
        try:
            with path.open("rb") as file:
                loaded = json.loads(file.read(_MAX_SUMMARY_BYTES))
        except (OSError, ValueError, RecursionError):
            continue
        if is_summary(loaded):
            found.append(loaded)
    return found


def _is_of_container(path: Path, folder: Path) -> bool:
    """Whether a path lies in the result files that `collect` copied beside its app.json: a container cannot write a run's summary."""
    return any(
        name == FILES and (folder.joinpath(*path.parts[:depth]) / APP).is_file()
        for depth, name in enumerate(path.parts)
    )
