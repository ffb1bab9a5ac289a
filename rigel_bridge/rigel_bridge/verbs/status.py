"""`rigel-bridge status` and `collect`: what an app shows of itself, in a few lines or copied into a folder."""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from rigel_bridge.cluster import apps, history
from rigel_bridge.cluster.instances import instances_of
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from rigel_bridge.cluster.results import collect, opened
from rigel_bridge.cluster.revisions import Revision, same
from rigel_bridge.cluster.waiting import condition
from rigel_bridge.document.failures import Exit
from rigel_bridge.sequences import lease
from rigel_bridge.verbs.cluster_options import add_app, kubectl_of, names_of, say, subject, tell
from rigel_bridge.verbs.verb import Verb

_CONDITIONS: Final = ("Accepted", "Allocated", "Placed", "Ready", "BudgetMet")
_INSTANCES_SHOWN: Final = 10
_NAME_SHOWN: Final = 80


def _status_arguments(parser: argparse.ArgumentParser) -> None:
    add_app(parser)
    parser.add_argument("-o", "--output", choices=("text", "json"), default="text", help="form (default: text)")


def _status(arguments: argparse.Namespace) -> int:
    kubectl = kubectl_of(arguments)
    ready = True
    for name in names_of(arguments):
        app = apps.existing(kubectl, name)
        instances, past = instances_of(kubectl, app), _history(kubectl, app)
        ready = ready and condition(app, "Ready")["status"] == "True"
        if arguments.output == "json":
            sys.stdout.write(json.dumps(_document(app, instances, past) | _run_of(app), indent=2) + "\n")
            continue
        headline, *more = _lines(app, instances, past)
        for line in (headline, *_run_line(app), *more):
            say(line)
    return Exit.OK if ready else Exit.NOT_READY


def _history(kubectl: Kubectl, app: Mapping[str, Any]) -> list[Revision]:
    try:
        return history.read(kubectl, app)
    except ClusterError as error:
        if error.reason is not Refusal.FORBIDDEN:
            raise
        return []


def _document(
    app: Mapping[str, Any], instances: Sequence[Mapping[str, Any]], past: Sequence[Revision]
) -> dict[str, Any]:
    return {
        "name": app["metadata"]["name"],
        "namespace": app["metadata"]["namespace"],
        "generation": app["metadata"]["generation"],
        "status": app.get("status", {}),
        "instances": [{"spec": item["spec"], "status": item.get("status", {})} for item in instances],
        "revisions": [
            {"revision": each.number, "created": each.created, "present": same(each.spec, app["spec"])} for each in past
        ],
    }


def _run_of(app: Mapping[str, Any]) -> dict[str, Any]:
    """The run of a sequence that made the app; empty for an app of no run."""
    sequence = lease.sequence_of(app)
    if sequence is None:
        return {}
    state, words = lease.state(app, _now())
    return {"run": {"sequence": sequence[:_NAME_SHOWN], "state": str(state), "message": words}}


def _now() -> datetime:
    return datetime.now(tz=UTC)


def _run_line(app: Mapping[str, Any]) -> list[str]:
    return [f"  run of sequence {run['sequence']} {run['message']}" for run in _run_of(app).values()]


def _lines(app: Mapping[str, Any], instances: Sequence[Mapping[str, Any]], past: Sequence[Revision]) -> Iterator[str]:
    status = app.get("status", {})
    summary = status.get("summary", {})
    shown = [f"{key} {summary[key]}" for key in ("ready", "robots", "domain", "budget", "devices") if summary.get(key)]
    yield f"{subject(dict(app))}: {', '.join([status.get('phase', 'Pending'), *shown])}"
    for kind in _CONDITIONS:
        found = condition(app, kind)
        if found["status"] != "True":
            yield f"  {kind} {found['status']}: {found.get('reason', '')}: {found.get('message', '')}"
    for item in instances[:_INSTANCES_SHOWN]:
        state = item.get("status", {})
        yield f"  instance {item['metadata']['name']}: {state.get('phase', 'Pending')}"
        for part in state.get("components", ()):
            ready = "ready" if part.get("ready") else f"not ready {part.get('message', '')}".strip()
            yield f"    {part['name']} on {part.get('node') or 'no node yet'}: {ready}"
    if len(instances) > _INSTANCES_SHOWN:
        yield f"  and {len(instances) - _INSTANCES_SHOWN} more instances: kubectl get robotappinstances"
    for each in past:
        mark = " (present)" if same(each.spec, app["spec"]) else ""
        yield f"  revision {each.number} of {each.created}{mark}"


STATUS: Final = Verb(
    name="status",
    summary="show how the app does, and its past specs",
    description="Show phase, conditions that are not met, where components run, and past specs. Exit code 75 unless it is Ready.",
    arguments=_status_arguments,
    run=_status,
    examples=(
        ("rigel-bridge status", "of what ./Rigelfile becomes"),
        ("rigel-bridge status amr-teleop -n fleet", "of an app by its name"),
        ("rigel-bridge status amr-teleop -o json", "for programs"),
    ),
)


def _collect_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="new or empty folder; with several apps each gets one below it")
    add_app(parser)
    parser.add_argument(
        "--path",
        default="",
        help="folder in the containers that holds results (default: results.source_path of the Rigelfile)",
    )


def _collect(arguments: argparse.Namespace) -> int:
    kubectl, names = kubectl_of(arguments), names_of(arguments)
    for name in names:
        app = apps.existing(kubectl, name)
        into = opened(arguments.folder / name if len(names) > 1 else arguments.folder)
        collect(kubectl, app, into, tell=tell, path=arguments.path)
        into.close()
        say(f"robotapp/{name}: {len(into.sums)} files in {into.folder}")
    return Exit.OK


COLLECT: Final = Verb(
    name="collect",
    summary="copy state, logs and result files into a folder",
    description=(
        "Copy what the app shows of itself: the RobotApp, its instances and pods as JSON, logs of at most 1 MiB, and the result "
        "files of the newest ready pod of each component (256 MiB; the container needs tar). manifest.json has a checksum of each."
    ),
    arguments=_collect_arguments,
    run=_collect,
    examples=(
        ("rigel-bridge collect results/today", "of what ./Rigelfile became"),
        ("rigel-bridge collect out amr-teleop --path /results", "result files of a folder in the containers"),
    ),
)
