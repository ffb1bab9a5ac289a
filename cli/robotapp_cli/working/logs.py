"""`logs`: what all containers of an app wrote, as one text."""

import asyncio
import heapq
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from rich.text import Text

from robotapp_api.values.printable import printable
from robotapp_api.values.quantities.duration import parse_us
from robotapp_cli.commands.watching import pause
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.output import console
from robotapp_cli.reading.fields import Json, status
from robotapp_cli.reading.pods import AppPod, Selection, explain_no_pods, fetch_app, list_pods
from robotapp_cli.reading.session import Session
from robotapp_client.api.client import with_query
from robotapp_client.api.resources import PODS
from robotapp_client.informer.watch_decoder import Lines
from robotapp_client.transport.errors import (
    ApiError,
    ServerError,
    TooManyRequests,
    Unreachable,
    error_from_response,
)

MOST_BYTES: Final = 16 * 2**20
"""Of one container's log, without --follow."""
MOST_BYTES_OF_ALL: Final = 128 * 2**20
"""Of all these logs, which are in memory together until they are in order."""
LEAST_BYTES: Final = 64 * 2**10
_LOOK_AGAIN_S: Final = 2.0
"""Pause between looks for new pods and containers that started again."""
_SILENCE_S: Final = 600.0
"""A stream without a byte for so long is opened again: its connection may be lost without a sign."""
_COLOURS: Final = ("cyan", "green", "magenta", "yellow", "blue", "bright_cyan", "bright_green", "bright_magenta")
_TERMINAL_SEQUENCE: Final = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """The choice of lines to print. `tail` -1 means all lines; `since` is a duration or empty."""

    follow: bool = False
    tail: int = 100
    since: str = ""
    previous: bool = False
    timestamps: bool = False


@dataclass(frozen=True, slots=True)
class LogSource:
    """One run of one container: a restart makes another."""

    pod: str
    container: str
    title: str
    """Robot, component and, for a container beside the main one, its name."""
    run: int = 0
    """How often the container was restarted before."""


@dataclass(frozen=True, slots=True, order=True)
class LogLine:
    """A line with the time at which the kubelet received it."""

    time: str
    title: str = field(compare=False)
    text: str = field(compare=False)


async def show_logs(session: Session, selection: Selection, options: LogOptions) -> None:
    """Prints the logs of the selected pods, and goes on with them if asked to. Raises CliError without a pod."""
    if options.follow and options.previous:
        raise CliError("--previous is about a run that ended: it cannot be followed", code=Exit.USAGE)
    query = build_query(options)
    app = await fetch_app(session, selection)
    if options.follow:
        await _follow(session, app, selection, query, LogPrinter(timestamps=options.timestamps))
        return
    pods = await list_pods(session, app, selection)
    sources = [source for pod in pods for source in list_sources(pod, previous=options.previous)]
    if not sources:
        raise explain_no_pods(session, app, selection)
    most_bytes = max(LEAST_BYTES, min(MOST_BYTES, MOST_BYTES_OF_ALL // len(sources)))
    answers = await asyncio.gather(*(_read(session, source, query, most_bytes) for source in sources))
    printer = LogPrinter(timestamps=options.timestamps, titles=[source.title for source in sources])
    for line in heapq.merge(*(lines for lines, _ in answers)):
        printer.print(line)
    for source, (_, problem) in zip(sources, answers, strict=True):
        if problem:
            printer.print_problem(source, problem)


def build_query(options: LogOptions) -> dict[str, str]:
    """Returns the query of the pod's log. Raises CliError for a time that is none."""
    query = {"timestamps": "true"}
    query |= {"tailLines": str(options.tail)} if options.tail >= 0 else {}
    query |= {"previous": "true"} if options.previous else {}
    if options.since:
        try:
            seconds = parse_us(options.since) // 1_000_000
        except ValueError as error:
            raise CliError(f"--since {options.since} is no duration; write 90s, 10m or 2h", code=Exit.USAGE) from error
        query["sinceSeconds"] = str(max(1, seconds))
    return query


def list_sources(pod: AppPod, *, previous: bool = False) -> Iterator[LogSource]:
    """Yields the containers of the pod that have written, or may have: those that started once."""
    pod_status = status(pod.obj)
    for key in ("initContainerStatuses", "containerStatuses"):
        for entry in pod_status.get(key) or ():
            name, restarts = str(entry["name"]), int(entry.get("restartCount", 0))
            has_started = restarts or not (entry.get("state") or {}).get("waiting")
            if has_started and (restarts or not previous):
                title = pod.title if name == pod.component else f"{pod.title}/{name}"
                yield LogSource(pod.name, name, title, restarts)


def parse_line(line: bytes, title: str) -> LogLine:
    """Returns the line, whose time stands before the first space."""
    time, _, text = line.decode(errors="replace").partition(" ")
    return LogLine(time, title, text.rstrip("\r"))


class LogPrinter:
    """Prints lines with the title of their source, which has a colour of its own on a terminal."""

    def __init__(self, *, timestamps: bool, titles: Iterable[str] = ()) -> None:
        self._timestamps = timestamps
        self._width = max(map(len, titles), default=0)
        self._console = console()

    def print(self, line: LogLine) -> None:
        """Prints the line. What would command the terminal, colours included, is left out or escaped."""
        self._width = max(self._width, len(line.title))
        text = Text(f"{line.title:<{self._width}} | ", style=choose_colour(line.title))
        time = f"{line.time} " if self._timestamps else ""
        text.append(printable(time + _TERMINAL_SEQUENCE.sub("", line.text), keep="\t"), style="default")
        self._console.print(text, soft_wrap=True)

    def print_problem(self, source: LogSource, problem: str) -> None:
        """Prints why a source cannot be read, or not as a whole."""
        self.print(LogLine("", source.title, f"({problem})"))


def choose_colour(title: str) -> str:
    """Returns the colour of a source, the same in each run."""
    return _COLOURS[zlib.crc32(title.encode()) % len(_COLOURS)]


async def _read(
    session: Session, source: LogSource, query: dict[str, str], most_bytes: int
) -> tuple[list[LogLine], str]:
    """Returns the first lines of a container, up to so many bytes, and a problem or ""."""
    path = _path(session, source, query | {"limitBytes": str(most_bytes)})
    try:
        response = await session.client.request("GET", path)
    except ApiError as error:
        return [], f"no log: {error.message}"
    is_cut = len(response.body) >= most_bytes
    problem = f"only the first {most_bytes // 1024} KiB are shown; write a lower --tail, or --since" if is_cut else ""
    return [parse_line(line, source.title) for line in response.body.splitlines()], problem


def _path(session: Session, source: LogSource, query: dict[str, str]) -> str:
    path = PODS.path(session.home, source.pod, "log")
    return with_query(path, query | {"container": source.container})


async def _follow(
    session: Session, app: Json, selection: Selection, query: dict[str, str], printer: LogPrinter
) -> None:
    """Prints what is written in all containers there are and will be, until it is cancelled."""
    tasks: dict[LogSource, asyncio.Task[None]] = {}
    is_announced = False
    try:
        while True:
            pods = await list_pods(session, app, selection)
            for source in (source for pod in pods for source in list_sources(pod)):
                if source not in tasks:
                    tasks[source] = asyncio.create_task(_follow_source(session, source, query, printer))
            if not tasks and not is_announced:
                printer.print_problem(
                    LogSource("", "", selection.app), "no log: no container has started yet; waiting for one"
                )
                is_announced = True
            await pause(_LOOK_AGAIN_S)
            for task in tasks.values():
                if task.done():
                    task.result()
    finally:
        for task in tasks.values():
            task.cancel()
        await asyncio.gather(*tasks.values(), return_exceptions=True)


async def _follow_source(session: Session, source: LogSource, query: dict[str, str], printer: LogPrinter) -> None:
    """Prints one run of a container until it ends. A connection that is lost goes on after the last line printed, also while
    the API server does not reach the node: robots are out of reach at times.
    """
    newest, last_problem = "", ""
    while True:
        printed_until = newest
        start = {"timestamps": "true", "sinceTime": newest} if newest else query
        try:
            async with session.client.stream(
                _path(session, source, start | {"follow": "true"}), silence_s=_SILENCE_S
            ) as stream:
                if stream.status != 200:
                    raise error_from_response(stream.status, stream.headers, await stream.read())
                lines = Lines()

                def take(pieces: Sequence[bytes], lines: Lines = lines, printed_until: str = printed_until) -> None:
                    nonlocal newest
                    for raw_line in lines.ended(pieces):
                        line = parse_line(raw_line, source.title)
                        newest = line.time
                        if line.time > printed_until:  # `sinceTime` counts whole seconds
                            printer.print(line)

                await stream.deliver(take)
        except (ServerError, TooManyRequests) as error:
            if error.message != last_problem:
                last_problem = error.message
                printer.print_problem(source, f"no log for now: {last_problem}")
            await pause(_LOOK_AGAIN_S)
        except ApiError as error:
            printer.print_problem(source, f"no log: {error.message}")
            return
        except Unreachable:
            await pause(_LOOK_AGAIN_S)
        else:
            return
