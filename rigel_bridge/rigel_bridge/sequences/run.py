"""Run one sequence: its jobs, the app, its results. The app is removed at the end, however the run ends."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
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
from rigel_bridge.sequences.comparison import is_summary
from rigel_bridge.sequences.lease import LEASE_S, Lease, goes_on, in_background, is_of, sequence_of
from rigel_bridge.sequences.samples import columns, edges, placement
from rigel_bridge.sequences.steps import Action, Kind, run_name
from rigel_bridge.source import Objects

_SHOWN_S: Final = 10.0
_SUMMARY: Final = "summary.json"
_MAX_SUMMARY_BYTES: Final = 16 * 1024 * 1024
UNFINISHED: Final = "unfinished"
"""The outcome until a run has another one: also of a run that was killed."""


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
    now: Callable[[], datetime] = lambda: datetime.now(tz=UTC)
    in_background: Callable[[Callable[[], None]], AbstractContextManager[None]] = in_background
    """Calls a function now and then, while the block lasts."""


@dataclass(slots=True)
class Outcome:
    """One app of a run. Its summary is complete only after a run without errors."""

    app: Mapping[str, Any]
    into: Collection
    summary: dict[str, Any]

    @property
    def name(self) -> str:
        return str(self.summary["app"])

    def write(self) -> None:
        self.into.add_json(_SUMMARY, self.summary)


def run(sequence: str, steps: Sequence[Action], objects: Objects, tools: Tools, into: Collection) -> list[Outcome]:
    """All steps in order, results in `into`. Errors pass through after results were collected and the apps removed."""
    lease = Lease(tools.kubectl, tools.run_id, tools.now)
    outcomes = _begun(sequence, objects.apps, into)
    with _written_at_the_end(outcomes, tools):
        for outcome in outcomes:
            _make_room(outcome.name, tools)
        with _renewed(lease, tools), _removed_at_the_end(outcomes, tools):
            for step in steps:
                _done(step, sequence=sequence, objects=objects, outcomes=outcomes, tools=tools, lease=lease)
    return outcomes


def _done(
    step: Action, *, sequence: str, objects: Objects, outcomes: Sequence[Outcome], tools: Tools, lease: Lease
) -> None:
    tools.tell(f"{sequence}: {step.job}")
    if step.note:
        tools.tell(f"note: {step.note}")
    if step.kind is Kind.RIGEL:
        for command in step.commands:
            tools.rigel(command)
    else:
        apply_claims(tools.kubectl, objects.claims)
        _deployed(sequence, outcomes, tools, lease)


def renamed(app: Mapping[str, Any], sequence: str) -> dict[str, Any]:
    """The app under the name of its run."""
    return {**app, "metadata": {**app["metadata"], "name": run_name(app["metadata"]["name"], sequence)}}


def annotated(app: Mapping[str, Any], more: Mapping[str, str]) -> dict[str, Any]:
    metadata = app["metadata"]
    return {**app, "metadata": {**metadata, "annotations": {**metadata.get("annotations", {}), **more}}}


def _begun(sequence: str, wanted: Sequence[Mapping[str, Any]], into: Collection) -> list[Outcome]:
    """The summaries stand in their folders from the beginning: those of a run that is killed stay `unfinished`."""
    found = []
    for app in (renamed(each, sequence) for each in wanted):
        name = app["metadata"]["name"]
        own = into if len(wanted) == 1 else Collection(into.folder / name)
        found.append(Outcome(app, own, {"sequence": sequence, "app": name, "outcome": UNFINISHED}))
        found[-1].write()
    return found


@contextmanager
def _written_at_the_end(outcomes: Sequence[Outcome], tools: Tools) -> Iterator[None]:
    """A run that ends before its apps were collected has failed, which another outcome than `unfinished` shows."""
    try:
        yield
    finally:
        for outcome in outcomes:
            if outcome.summary["outcome"] == UNFINISHED:
                outcome.summary["outcome"] = "failed"
                try:
                    outcome.write()
                except BridgeError as error:
                    tools.tell(f"results of {outcome.name}: {error}")


@contextmanager
def _renewed(lease: Lease, tools: Tools) -> Iterator[None]:
    """Keep the lease until the apps are removed; apps that stay are released."""
    try:
        with tools.in_background(lease.renew):
            yield
    finally:
        if tools.keep:
            lease.release()


def _make_room(name: str, tools: Tools) -> None:
    """Refuse a name that is in use, and clear what an earlier run left: with --keep, or because it was killed."""
    present = apps.read(tools.kubectl, name)
    if present is None:
        return
    if sequence_of(present) is None:
        raise ClusterError(
            f"RobotApp {name} is there and of no earlier run: a run would replace and delete it; choose another --name"
        )
    tools.tell(f"{name}: of an earlier run; it is removed unless that run shows within {LEASE_S:g} s that it goes on")
    if goes_on(tools.kubectl, present, clock=tools.clock):
        raise ClusterError(
            f"RobotApp {name} is of a run that goes on: wait for its end, or choose another --name; "
            f"`rigel-bridge status {name}` shows it"
        )
    tools.tell(f"{name}: removed")
    remove(tools.kubectl, name, timeout_s=tools.limits.removal_s, clock=tools.clock)


@contextmanager
def _removed_at_the_end(outcomes: Sequence[Outcome], tools: Tools) -> Iterator[None]:
    try:
        yield
    finally:
        for outcome in outcomes if not tools.keep else ():
            present = apps.read(tools.kubectl, outcome.name)
            if present is not None and not is_of(present, tools.run_id):
                tools.tell(f"{outcome.name}: is of another run by now, and stays")
                continue
            tools.tell(f"{outcome.name}: removed")
            remove(tools.kubectl, outcome.name, timeout_s=tools.limits.removal_s, clock=tools.clock)


def _require_own(name: str, tools: Tools) -> None:
    """ClusterError when another run has taken the place of this one: its figures are not ours."""
    if not is_of(apps.existing(tools.kubectl, name), tools.run_id):
        raise ClusterError(
            f"RobotApp {name} is of another run by now: run one sequence at a time, or choose another --name"
        )


def _deployed(sequence: str, outcomes: Sequence[Outcome], tools: Tools, lease: Lease) -> None:
    """Bring all apps in, let them work, collect. Results are collected also of an app that does not become Ready."""
    begun_s = tools.clock.now_s()
    for outcome in outcomes:  # a build takes long enough for another run to begin
        _make_room(outcome.name, tools)
    lease.take([outcome.name for outcome in outcomes])
    ran = False
    try:
        for outcome in outcomes:
            deploy(tools.kubectl, annotated(outcome.app, lease.annotations(sequence)), tell=tools.tell)
        for outcome in outcomes:
            name = outcome.name
            wait_ready(tools.kubectl, name, timeout_s=tools.limits.ready_s, clock=tools.clock, tell=tools.tell)
            outcome.summary["ready_after_s"] = tools.clock.now_s() - begun_s
            _settled(name, tools)
        tools.tell(f"{sequence}: Ready, working for {tools.limits.duration_s:g} s")
        tools.clock.sleep(tools.limits.duration_s)
        for outcome in outcomes:
            _require_own(outcome.name, tools)
        ran = True
    finally:
        for outcome in outcomes:
            outcome.summary["outcome"] = "ran" if ran else "failed"
            _collected(outcome, tools)


def _settled(name: str, tools: Tools) -> None:
    """Wait until the instances show where components run: they are written after the app's own status."""
    app = apps.existing(tools.kubectl, name)

    def shown() -> bool:
        found = placement(instances_of(tools.kubectl, app))
        return bool(found) and all(each["ready"] for each in found)

    if not tools.clock.until(shown, timeout_s=_SHOWN_S):
        tools.tell(f"{name}: no instance shows its components yet, so the summary has no nodes")


def _collected(outcome: Outcome, tools: Tools) -> None:
    """A failing collection hides no earlier failure: it is told, and the run goes on to its end."""
    own = outcome.into
    try:
        app = apps.read(tools.kubectl, outcome.name)
        if app is None or not is_of(app, tools.run_id):
            outcome.write()
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
        outcome.write()
        own.close()
    except BridgeError as error:
        tools.tell(f"results of {outcome.name}: {error}")


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
