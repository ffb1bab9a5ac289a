"""`what-if`: what would be different with a node lost, a slower pair of nodes, another app or another configuration.

The running scheduler decides it on a copy of its own state, so nothing is written and no rights on the cluster's objects are
needed beside those to see pods and, to name nodes, to get nodes.
"""

import asyncio
import json
import sys
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Final
from urllib.parse import quote

from robotapp_api.model.names import API_VERSION, SYSTEM_NAMESPACE
from robotapp_api.values.arguments import is_name
from robotapp_api.values.printable import printable
from robotapp_api.values.quantities.duration import format_us, parse_us
from robotapp_cli.commands.simulate import document
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.output import Column, arrow, blank_line, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json
from robotapp_cli.reading.files import objects
from robotapp_cli.reading.scheduler_link import Link, NoAnswerError, connect
from robotapp_cli.reading.session import Session

_MOST_BYTES: Final = 1 << 20
_PROGRESS_AFTER_S: Final = 2.0
_TURN_S: Final = 1.0
_MOST_TURN_S: Final = 20.0
_USAGE, _NO_SUCH_NODE = 400, 422
_MOST_REFUSALS: Final = 5
"""So many mistakes of an app are shown; `lint` shows all."""
_PAIR: Final = "a pair of nodes and its round-trip time, such as edge-1:amr-07=40ms"
_EXITS: Final = {_USAGE: Exit.USAGE, _NO_SUCH_NODE: Exit.NOT_FOUND}
_GONE: Final = "-"


@dataclass(frozen=True, slots=True, kw_only=True)
class WhatIfRequest:
    """The changes that the user supposes, all of them at once."""

    node_loss: Sequence[str] = ()
    rtt: Sequence[str] = ()
    apps: Sequence[Path] = ()
    config: Path | None = None
    replay: int = 0
    """So many of the latest placements are judged with `config`, and nothing else is supposed."""
    scheduler_url: str | None = None
    scheduler_namespace: str = SYSTEM_NAMESPACE


async def show_what_if(session: Session, request: WhatIfRequest) -> None:
    """Prints the pods that would move and the edges whose verdict would change."""
    content = json.dumps(build_question(request, namespace=session.home), separators=(",", ":")).encode()
    if len(content) > _MOST_BYTES:
        raise CliError(f"the files are {len(content) >> 10} KiB of JSON, the scheduler takes 1024 KiB", code=Exit.USAGE)
    async with connect(session, url=request.scheduler_url, namespace=request.scheduler_namespace) as link:
        answer = await _fetch_answer(link, f"/what-if?namespace={quote(session.home)}", content)
    if session.options.output.structured:
        write_structured(answer, session.options.output)
    else:
        _print(answer, is_replay=bool(request.replay))


def build_question(request: WhatIfRequest, *, namespace: str) -> Json:
    """Returns the body of the request. Apps without a namespace get this one. Raises CliError for what cannot be asked."""
    question: Json = {
        "nodeLoss": [_check_node(name, f"--node-loss {name}") for name in request.node_loss],
        "rtt": [parse_pair(text) for text in request.rtt],
        "apps": [app for path in request.apps for app in _read_apps(path, namespace)],
    }
    if request.config is not None:
        question["config"] = document(request.config)
    if request.replay:
        return _add_replay(question, request.replay)
    if not any(question.values()):
        raise CliError("nothing is supposed: give --node-loss, --rtt, --app or --config", code=Exit.USAGE)
    return question


def _add_replay(question: Json, count: int) -> Json:
    """Returns the question with the number of placements to judge. Raises CliError: they are judged with a configuration alone."""
    if "config" not in question:
        raise CliError(f"--replay {count}: give --config FILE, the configuration to judge them with", code=Exit.USAGE)
    if question["nodeLoss"] or question["rtt"] or question["apps"]:
        text = f"--replay {count} goes with --config alone: leave --node-loss, --rtt and --app out"
        raise CliError(text, code=Exit.USAGE)
    return question | {"replay": count}


def parse_pair(text: str) -> Json:
    """Returns `A:B=40ms` as the scheduler takes it. Raises CliError."""
    nodes, equals, rtt = text.partition("=")
    one, colon, other = nodes.partition(":")
    if not (equals and colon):
        raise CliError(f"--rtt {text}: write {_PAIR}", code=Exit.USAGE)
    if one == other:
        raise CliError(f"--rtt {text}: the two nodes are one; write {_PAIR}", code=Exit.USAGE)
    try:
        parse_us(rtt)
    except ValueError as error:
        raise CliError(f"--rtt {text}: {error}", code=Exit.USAGE) from error
    return {"one": _check_node(one, f"--rtt {text}"), "other": _check_node(other, f"--rtt {text}"), "rtt": rtt}


def _check_node(name: str, where: str) -> str:
    """Returns the name. Raises CliError for what no node can be called."""
    if not is_name(name):
        raise CliError(f"{where}: {name!r} is no name of a node: kubectl robotapp nodes lists them", code=Exit.USAGE)
    return name


def _read_apps(path: Path, namespace: str) -> list[Json]:
    """Returns the RobotApps of a file. Other objects of it change nothing here. Raises CliError."""
    file_objects = list(objects(path, most_bytes=_MOST_BYTES))
    apps = [obj for obj in file_objects if obj.get("kind") == "RobotApp"]
    if not apps:
        kinds = ", ".join(sorted({str(obj.get("kind")) for obj in file_objects})) or "nothing"
        raise CliError(f"--app {path}: holds no RobotApp of {API_VERSION}, but {kinds}", code=Exit.USAGE)
    for app in apps:
        meta = app.get("metadata")
        if not isinstance(meta, dict) or not meta.get("name"):
            raise CliError(f"--app {path}: holds a RobotApp without metadata.name", code=Exit.USAGE)
        meta.setdefault("namespace", namespace)
        _check_app(path, app)
    return [{key: app[key] for key in ("apiVersion", "kind", "metadata", "spec") if key in app} for app in apps]


def _check_app(path: Path, app: Json) -> None:
    """Raises CliError for an app that could not be applied: nothing of it would be placed."""
    from robotapp_cli.lint.findings import Severity  # the schema, jsonschema and CEL take half a second to import
    from robotapp_cli.lint.linter import lint

    errors = [finding for finding in lint(json.dumps(app).encode()).findings if finding.severity is Severity.ERROR]
    if not errors:
        return
    lines = [f"  {error.path}: {printable(error.message)}" for error in errors[:_MOST_REFUSALS]]
    if len(errors) > _MOST_REFUSALS:
        lines.append(f"  and {len(errors) - _MOST_REFUSALS} more")
    name = printable(str(app["metadata"]["name"]))
    where = f"--app {path}: RobotApp {name} would be refused; kubectl robotapp lint {path} shows the places"
    raise CliError("\n".join([where, *lines]))


# --- Asking -----------------------------------------------------------------------------------------------------------


async def _fetch_answer(link: Link, path: str, content: bytes) -> Json:
    try:
        async with _show_progress():
            return await _post_in_turn(link, path, content)
    except NoAnswerError as error:
        if not error.status:
            raise CliError(f"the scheduler did not answer: {error}") from error
        if code := _EXITS.get(error.status):
            raise CliError(error.why or str(error), code=code) from error
        raise CliError(f"the scheduler refuses: {error.why or error} ({error.status})") from error


async def _post_in_turn(link: Link, path: str, content: bytes) -> Json:
    """Returns the scheduler's answer. While it has too many such questions, this one is sent again, for twenty seconds at most."""
    until_s = time.monotonic() + _MOST_TURN_S
    while True:
        try:
            return await link.post(path, content)
        except NoAnswerError as error:
            if error.status != HTTPStatus.TOO_MANY_REQUESTS or time.monotonic() >= until_s:
                raise
            await asyncio.sleep(_TURN_S)


@asynccontextmanager
async def _show_progress() -> AsyncIterator[None]:
    """Shows a line on a terminal after two seconds, and removes it at the end."""

    async def write_line() -> None:
        await asyncio.sleep(_PROGRESS_AFTER_S)
        sys.stderr.write("the scheduler is deciding …\r")
        sys.stderr.flush()

    line_task = asyncio.create_task(write_line()) if sys.stderr.isatty() else None
    try:
        yield
    finally:
        if line_task is not None:
            if line_task.done():
                sys.stderr.write("\x1b[K")
            line_task.cancel()


# --- Showing ----------------------------------------------------------------------------------------------------------


def _print(answer: Json, *, is_replay: bool) -> None:
    pods, edges = answer["pods"], answer["edges"]
    if pods:
        _print_pods(pods)
    else:
        print_line("No pod would sit elsewhere." if is_replay else "No pod would move.")
    blank_line()
    if edges:
        _print_edges(edges)
    else:
        print_line("No edge would get another verdict.")
    blank_line()
    if is_replay:
        print_line(f"{answer['replayed']} placements were judged, each as if that pod alone was not placed")
    for line in _summarize(answer):
        print_line(line)


def _print_pods(pods: Sequence[Json]) -> None:
    columns = [Column(name) for name in ("NAMESPACE", "APP", "INSTANCE", "COMPONENT", "POD", "WHAT", "FROM", "TO")]
    rows = [
        [
            pod["namespace"],
            pod["app"] or _GONE,
            pod["instance"] or _GONE,
            pod["component"] or _GONE,
            pod["pod"],
            pod["outcome"],
            pod["from"] or _GONE,
            pod["to"] or _GONE,
            pod["reason"],
        ]
        for pod in pods
    ]
    print_table([*columns, Column("WHY", wraps=True)], rows)


def _print_edges(edges: Sequence[Json]) -> None:
    columns = [Column(name) for name in ("NAMESPACE", "APP", "INSTANCE", "EDGE", "BUDGET", "BEFORE", "AFTER")]
    rows = [
        [
            edge["namespace"],
            edge["app"],
            edge["instance"] or _GONE,
            f"{edge['from']} {arrow()} {edge['to']} {edge['edge']}",
            f"{format_us(1000 * edge['budgetMs'])} p{edge['percentile']}",
            _format_state(edge["before"]),
            _format_state(edge["after"]),
        ]
        for edge in edges
    ]
    print_table(columns, rows)


def _format_state(state: Json | None) -> str:
    """Returns a verdict with its number. One without a number that is exceeded had no answer to its probes."""
    if state is None:
        return _GONE
    if state["rttMs"] is not None:
        estimated = ", estimated" if state["source"] == "estimated" else ""
        return f"{state['verdict']} ({format_us(1000 * state['rttMs'])}{estimated})"
    return f"{state['verdict']} (no answer)" if state["verdict"] == "Exceeded" else str(state["verdict"])


def _summarize(answer: Json) -> list[str]:
    hidden = answer["hidden"]
    more = "more " if answer["edges"] else ""
    lines = [f"{answer['edgesUnchanged']} {more}edges were looked at: their verdict stays"]
    if hidden["pods"] or hidden["edges"]:
        lines.append(f"{hidden['pods']} pods and {hidden['edges']} edges of other namespaces would change, too")
    return [*lines, *answer["notes"], "Nothing was changed."]
