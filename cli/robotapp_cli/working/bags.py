"""`bags list`, `bags info`, `bags pull`: the bags of an app's recordings, read in the recorder's container through `kubectl exec`."""

import json
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final

import typer

from robotapp_api.values.recordings.components import PROGRAM, folder_of
from robotapp_cli.arguments import Context, Kubeconfig, Name, Namespace, OptionalComponent, OutputFormat, Robot
from robotapp_cli.failures import CliError, Exit, ended_by
from robotapp_cli.output import Output, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json
from robotapp_cli.reading.pods import AppPod, Selection, fetch_app, list_pods
from robotapp_cli.reading.session import Options, Session, run

MOST_ANSWER: Final = 4 << 20
"""Bytes of an answer of the recorder; 10,000 bags take 1 MiB."""
_URL: Final = re.compile(r'"https?://[^"]*":? ?')
"""In an error of kubectl: the whole command line, which hides the reason behind it."""
_NAME: Final = re.compile(r"[a-z0-9][-A-Za-z0-9]{0,127}\.mcap(\.open)?")
"""Names that a recorder gives; the pod is the author's, so another one is not used as the name of a file here."""


@dataclass(frozen=True, slots=True)
class Recorder:
    """The pod of one recording."""

    pod: AppPod
    folder: str

    def build_command(self, options: Options, *command: str) -> list[str]:
        """Returns the command line of kubectl that runs a program in the recorder's container."""
        arguments = ["kubectl", "exec", f"--namespace={self.pod.obj['metadata']['namespace']}"]
        arguments += [f"--container={self.pod.component}"]
        arguments += [f"--context={options.context}"] if options.context else []
        arguments += [f"--kubeconfig={options.kubeconfig}"] if options.kubeconfig else []
        return [*arguments, self.pod.name, "--", *command]


def add_bag_commands(app: typer.Typer) -> None:
    """Adds `bags` with its commands to the program."""
    bags = typer.Typer(help="Bags of an app's recordings.", no_args_is_help=True)
    bags.command("list", epilog="Example: kubectl robotapp bags list patrol --robot amr-07")(list_command)
    bags.command("info", epilog="Example: kubectl robotapp bags info patrol drive-000012-20260101T120000Z.mcap")(
        info_command
    )
    bags.command("pull", epilog="Example: kubectl robotapp bags pull patrol --to bags/")(pull_command)
    app.add_typer(bags, name="bags")


def list_command(
    name: Name,
    recording: OptionalComponent = None,
    *,
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """List the bags with size and state."""
    options = Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output)

    def show(recorders: Sequence[Recorder]) -> None:
        rows = [(recorder, bag) for recorder in recorders for bag in read_bags(options, recorder)]
        if output.structured:
            write_structured(
                [bag | {"recording": recorder.pod.component, "robot": recorder.pod.robot} for recorder, bag in rows],
                output,
            )
            return
        print_table(
            ["ROBOT", "RECORDING", "BAG", "BYTES", "STATE"],
            [
                (recorder.pod.robot, recorder.pod.component, bag["name"], f"{bag['bytes']:,}", bag["state"])
                for recorder, bag in rows
            ],
        )

    _with_recorders(options, Selection(name, recording, robot), show)


def info_command(
    name: Name,
    bag: Annotated[str, typer.Argument(metavar="BAG", help="Name of a bag, as bags list prints it.")],
    *,
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Show the topics of a closed bag and how many messages it has."""
    options = Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output)

    def show(recorders: Sequence[Recorder]) -> None:
        recorder, _ = _choose_bag(options, recorders, bag)
        info = _ask(options, recorder, "info", bag)
        if output.structured:
            write_structured(info, output)
            return
        seconds = (info["endedNs"] - info["beganNs"]) / 1e9
        print_line(f"{bag}: {info['messages']} messages in {seconds:.1f} s, {info['bytes']:,} bytes")
        print_table(
            ["TOPIC", "TYPE", "MESSAGES"],
            [(str(topic["topic"]), str(topic["type"]), str(topic["messages"])) for topic in info["topics"]],
        )

    _with_recorders(options, Selection(name, None, robot), show)


def pull_command(
    name: Name,
    bags: Annotated[
        list[str] | None, typer.Argument(metavar="[BAG]...", help="Bags (default: all closed ones).")
    ] = None,
    *,
    to: Annotated[Path, typer.Option("--to", help="Folder for the bags; a file there is never overwritten.")] = Path(),
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Copy bags to this machine."""
    options = Options(namespace=namespace, context=context, kubeconfig=kubeconfig)

    def copy(recorders: Sequence[Recorder]) -> None:
        chosen = (
            [_choose_bag(options, recorders, bag) for bag in bags] if bags else list(_list_closed(options, recorders))
        )
        for recorder, bag in chosen:
            path = to / recorder.pod.robot / bag["name"]
            if path.exists():
                print_line(f"{path} is there already")
                continue
            pull_bag(recorder.build_command(options, "cat", f"{recorder.folder}/{bag['name']}"), path, bag["bytes"])
            print_line(f"{path}: {bag['bytes']:,} bytes")

    _with_recorders(options, Selection(name, None, robot), copy)


def read_bags(options: Options, recorder: Recorder) -> list[dict[str, Any]]:
    """Returns the bags of a recording. Raises CliError for an answer that no recorder gives."""
    answer = _ask(options, recorder, "list")
    try:
        bags = [{"name": str(bag["name"]), "bytes": int(bag["bytes"]), "state": str(bag["state"])} for bag in answer]
    except (TypeError, KeyError, ValueError) as error:
        raise CliError(f"pod {recorder.pod.name} answers with something else than a list of bags") from error
    for bag in bags:
        if not _NAME.fullmatch(str(bag["name"])):
            raise CliError(f"pod {recorder.pod.name} has a bag with a name that no recorder gives: {bag['name']!r}")
    return bags


def pull_bag(command: Sequence[str], path: Path, size: int) -> None:
    """Writes what a command prints to a new file, which has its name only when it is complete. Raises CliError."""
    part = path.with_name(f"{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            result = _run_kubectl(command, file)
    except OSError as error:
        text = f"{path.parent} cannot be written: {error.strerror}; give another folder as --to"
        raise CliError(text, code=Exit.USAGE) from error
    if result.returncode != 0 or part.stat().st_size != size:
        received_bytes = part.stat().st_size
        part.unlink()
        cause = result.stderr.decode(errors="replace").strip()[-300:]
        raise CliError(f"{path.name}: {received_bytes} of {size} bytes arrived {cause}; run it again")
    part.rename(path)


def _list_closed(options: Options, recorders: Sequence[Recorder]) -> Iterator[tuple[Recorder, dict[str, Any]]]:
    for recorder in recorders:
        for bag in read_bags(options, recorder):
            if bag["state"] == "closed":
                yield recorder, bag


def _choose_bag(options: Options, recorders: Sequence[Recorder], name: str) -> tuple[Recorder, dict[str, Any]]:
    for recorder in recorders:
        for bag in read_bags(options, recorder):
            if bag["name"] == name:
                return recorder, bag
    raise CliError(f"no recording has a bag {name}; kubectl robotapp bags list shows them", code=Exit.NOT_FOUND)


def _with_recorders(options: Options, selection: Selection, act: Callable[[Sequence[Recorder]], None]) -> None:
    """Calls `act` with the running recorders of the selection, and prints its failure."""
    recorders = run(options, lambda session: _find_recorders(session, selection))
    try:
        act(recorders)
    except CliError as failure:
        raise ended_by(failure) from failure


async def _find_recorders(session: Session, selection: Selection) -> list[Recorder]:
    app: Json = await fetch_app(session, selection)
    names = {str(recording["name"]) for recording in app["spec"].get("recordings") or ()}
    if not names:
        raise CliError(
            f"{selection.app} has no recordings; write spec.recordings, for example "
            '[{name: all, topics: {regex: ".*"}}]',
            code=Exit.NOT_FOUND,
        )
    pods = [pod for pod in await list_pods(session, app, selection) if pod.component in names and pod.is_running]
    if not pods:
        raise CliError(
            f"no recorder of {selection.app} is running, and bags are read through it; "
            f"{session.write_command('info', selection.app)} has the reason",
            code=Exit.NOT_FOUND,
        )
    return [Recorder(pod, folder_of(selection.app, pod.robot, pod.component)) for pod in pods]


def _ask(options: Options, recorder: Recorder, verb: str, *arguments: str) -> Any:
    command = recorder.build_command(options, *PROGRAM, verb, f"--folder={recorder.folder}", *arguments)
    result = _run_kubectl(command, subprocess.PIPE)
    if result.returncode != 0:
        cause = _URL.sub("", result.stderr.decode(errors="replace")).strip()[-300:]
        text = f"pod {recorder.pod.name} cannot be asked for its bags: {cause}; kubectl exec has to reach it"
        raise CliError(text)
    if len(result.stdout) > MOST_ANSWER:
        raise CliError(f"pod {recorder.pod.name} answers with more than {MOST_ANSWER >> 20} MiB")
    try:
        return json.loads(result.stdout)
    except ValueError as error:
        raise CliError(f"pod {recorder.pod.name} answers with something else than JSON") from error


def _run_kubectl(command: Sequence[str], output: int | BinaryIO) -> subprocess.CompletedProcess[bytes]:
    try:
        return subprocess.run(command, stdout=output, stderr=subprocess.PIPE, check=False)
    except OSError as error:
        raise CliError(
            f"kubectl cannot be started: {error.strerror}; bags need it on the PATH", code=Exit.USAGE
        ) from error
