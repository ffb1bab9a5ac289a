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
class Supposition:
    """What the user supposes; all of it at once."""

    node_loss: Sequence[str] = ()
    rtt: Sequence[str] = ()
    apps: Sequence[Path] = ()
    config: Path | None = None
    replay: int = 0
    """So many of the latest placements are judged with `config`, and nothing else is supposed."""
    scheduler_url: str | None = None
    scheduler_namespace: str = SYSTEM_NAMESPACE


async def show_what_if(session: Session, supposed: Supposition) -> None:
    """Print the pods that would move and the edges whose verdict would change."""
    content = json.dumps(question_of(supposed, namespace=session.home), separators=(",", ":")).encode()
    if len(content) > _MOST_BYTES:
        raise CliError(f"the files are {len(content) >> 10} KiB of JSON, the scheduler takes 1024 KiB", code=Exit.USAGE)
    async with connect(session, url=supposed.scheduler_url, namespace=supposed.scheduler_namespace) as link:
        found = await _answer(link, f"/what-if?namespace={quote(session.home)}", content)
    if session.options.output.structured:
        write_structured(found, session.options.output)
    else:
        _print(found, is_replay=bool(supposed.replay))


def question_of(supposed: Supposition, *, namespace: str) -> Json:
    """The body of the request. Raises CliError for what cannot be asked; apps without a namespace are of this one."""
    question: Json = {
        "nodeLoss": [_node(name, f"--node-loss {name}") for name in supposed.node_loss],
        "rtt": [pair_of(text) for text in supposed.rtt],
        "apps": [app for path in supposed.apps for app in _apps(path, namespace)],
    }
    if supposed.config is not None:
        question["config"] = document(supposed.config)
    if supposed.replay:
        return _add_replay(question, supposed.replay)
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


def pair_of(text: str) -> Json:
    """`A:B=40ms` as the scheduler takes it. Raises CliError."""
    nodes, given, rtt = text.partition("=")
    one, colon, other = nodes.partition(":")
    if not (given and colon):
        raise CliError(f"--rtt {text}: write {_PAIR}", code=Exit.USAGE)
    if one == other:
        raise CliError(f"--rtt {text}: the two nodes are one; write {_PAIR}", code=Exit.USAGE)
    try:
        parse_us(rtt)
    except ValueError as error:
        raise CliError(f"--rtt {text}: {error}", code=Exit.USAGE) from error
    return {"one": _node(one, f"--rtt {text}"), "other": _node(other, f"--rtt {text}"), "rtt": rtt}


def _node(name: str, where: str) -> str:
    if not is_name(name):
        raise CliError(f"{where}: {name!r} is no name of a node: kubectl robotapp nodes lists them", code=Exit.USAGE)
    return name


def _apps(path: Path, namespace: str) -> list[Json]:
    """The RobotApps of a file. Other objects of it change nothing here."""
    found = list(objects(path, most_bytes=_MOST_BYTES))
    apps = [each for each in found if each.get("kind") == "RobotApp"]
    if not apps:
        kinds = ", ".join(sorted({str(each.get("kind")) for each in found})) or "nothing"
        raise CliError(f"--app {path}: holds no RobotApp of {API_VERSION}, but {kinds}", code=Exit.USAGE)
    for app in apps:
        meta = app.get("metadata")
        if not isinstance(meta, dict) or not meta.get("name"):
            raise CliError(f"--app {path}: holds a RobotApp without metadata.name", code=Exit.USAGE)
        meta.setdefault("namespace", namespace)
        _check(path, app)
    return [{key: app[key] for key in ("apiVersion", "kind", "metadata", "spec") if key in app} for app in apps]


def _check(path: Path, app: Json) -> None:
    """Raise CliError for an app that could not be applied: nothing would be placed, whatever the scheduler makes of it."""
    from robotapp_cli.lint.findings import Severity  # the schema, jsonschema and CEL take half a second to import
    from robotapp_cli.lint.linter import lint

    wrong = [found for found in lint(json.dumps(app).encode()).findings if found.severity is Severity.ERROR]
    if not wrong:
        return
    lines = [f"  {each.path}: {printable(each.message)}" for each in wrong[:_MOST_REFUSALS]]
    if len(wrong) > _MOST_REFUSALS:
        lines.append(f"  and {len(wrong) - _MOST_REFUSALS} more")
    name = printable(str(app["metadata"]["name"]))
    where = f"--app {path}: RobotApp {name} would be refused; kubectl robotapp lint {path} shows the places"
    raise CliError("\n".join([where, *lines]))


# --- Asking -----------------------------------------------------------------------------------------------------------


async def _answer(link: Link, path: str, content: bytes) -> Json:
    try:
        async with _progress():
            return await _in_turn(link, path, content)
    except NoAnswerError as error:
        if not error.status:
            raise CliError(f"the scheduler did not answer: {error}") from error
        if code := _EXITS.get(error.status):
            raise CliError(error.why or str(error), code=code) from error
        raise CliError(f"the scheduler refuses: {error.why or error} ({error.status})") from error


async def _in_turn(link: Link, path: str, content: bytes) -> Json:
    """The scheduler's answer. While it has too many such questions, this one is sent again, for twenty seconds at most."""
    until_s = time.monotonic() + _MOST_TURN_S
    while True:
        try:
            return await link.post(path, content)
        except NoAnswerError as error:
            if error.status != HTTPStatus.TOO_MANY_REQUESTS or time.monotonic() >= until_s:
                raise
            await asyncio.sleep(_TURN_S)


@asynccontextmanager
async def _progress() -> AsyncIterator[None]:
    """After two seconds a line on a terminal that work is being done, taken away again at the end."""

    async def tell() -> None:
        await asyncio.sleep(_PROGRESS_AFTER_S)
        sys.stderr.write("the scheduler is deciding …\r")
        sys.stderr.flush()

    shown = asyncio.create_task(tell()) if sys.stderr.isatty() else None
    try:
        yield
    finally:
        if shown is not None:
            if shown.done():
                sys.stderr.write("\x1b[K")
            shown.cancel()


# --- Showing ----------------------------------------------------------------------------------------------------------


def _print(found: Json, *, is_replay: bool) -> None:
    pods, edges = found["pods"], found["edges"]
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
        print_line(f"{found['replayed']} placements were judged, each as if that pod alone was not placed")
    for line in _summary(found):
        print_line(line)


def _print_pods(pods: Sequence[Json]) -> None:
    columns = [Column(name) for name in ("NAMESPACE", "APP", "INSTANCE", "COMPONENT", "POD", "WHAT", "FROM", "TO")]
    rows = [
        [
            each["namespace"],
            each["app"] or _GONE,
            each["instance"] or _GONE,
            each["component"] or _GONE,
            each["pod"],
            each["outcome"],
            each["from"] or _GONE,
            each["to"] or _GONE,
            each["reason"],
        ]
        for each in pods
    ]
    print_table([*columns, Column("WHY", wraps=True)], rows)


def _print_edges(edges: Sequence[Json]) -> None:
    columns = [Column(name) for name in ("NAMESPACE", "APP", "INSTANCE", "EDGE", "BUDGET", "BEFORE", "AFTER")]
    rows = [
        [
            each["namespace"],
            each["app"],
            each["instance"] or _GONE,
            f"{each['from']} {arrow()} {each['to']} {each['edge']}",
            f"{format_us(1000 * each['budgetMs'])} p{each['percentile']}",
            _state(each["before"]),
            _state(each["after"]),
        ]
        for each in edges
    ]
    print_table(columns, rows)


def _state(state: Json | None) -> str:
    """A verdict with its number; one without a number that is exceeded had no answer to its probes."""
    if state is None:
        return _GONE
    if state["rttMs"] is not None:
        estimated = ", estimated" if state["source"] == "estimated" else ""
        return f"{state['verdict']} ({format_us(1000 * state['rttMs'])}{estimated})"
    return f"{state['verdict']} (no answer)" if state["verdict"] == "Exceeded" else str(state["verdict"])


def _summary(found: Json) -> list[str]:
    hidden = found["hidden"]
    lines = [f"{found['edgesUnchanged']} more edges were looked at: their verdict stays"]
    if hidden["pods"] or hidden["edges"]:
        lines.append(f"{hidden['pods']} pods and {hidden['edges']} edges of other namespaces would change, too")
    return [*lines, *found["notes"], "Nothing was changed."]
