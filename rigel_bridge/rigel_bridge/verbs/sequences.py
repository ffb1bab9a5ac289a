"""`rigel-bridge sequences`: list the sequences of a Rigelfile, run them, compare what they left."""

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

from rigel_bridge.cluster.results import opened
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.document.failures import BridgeError, Exit, Place, nearest
from rigel_bridge.sequences.comparison import table
from rigel_bridge.sequences.run import UNFINISHED, Limits, Tools, read_summaries, run
from rigel_bridge.sequences.steps import Action, Kind, actions, described, folder_name, refuse_thesis
from rigel_bridge.source import Objects, objects
from rigel_bridge.verbs.cluster_options import add_cluster, ended_like_ctrl_c, kubectl_of, say, seconds, tell
from rigel_bridge.verbs.options import add_source, source_of, tell_notes
from rigel_bridge.verbs.verb import Verb


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_source(parser, with_choice=False)
    parser.add_argument(
        "--run",
        dest="chosen",
        nargs="+",
        default=[],
        metavar="NAME",
        help="sequences to run, one after the other (default: list them)",
    )
    parser.add_argument("--results", type=Path, help="new folder for results (default: results/<time>)")
    parser.add_argument(
        "--compare", type=Path, metavar="FOLDER", help="compare the runs whose results are below this folder"
    )
    parser.add_argument(
        "--duration", type=seconds, default=30.0, help="how long an app works once it is Ready (default: 30s)"
    )
    parser.add_argument(
        "--wait", type=seconds, default=120.0, metavar="DURATION", help="longest time until it is Ready (default: 2m)"
    )
    parser.add_argument(
        "--build-timeout",
        type=seconds,
        default=1800.0,
        metavar="DURATION",
        help="longest time of a job of Rigel (default: 30m)",
    )
    parser.add_argument(
        "--load", action="store_true", help="of a list of packages: keep images on this machine instead of pushing them"
    )
    parser.add_argument(
        "--no-build", action="store_true", help="leave the jobs of Rigel out: the image is in the registry already"
    )
    parser.add_argument("--keep", action="store_true", help="leave the apps in the cluster")
    add_cluster(parser)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.compare is not None:
        return _compared(arguments.compare)
    rigelfile = objects(source_of(arguments)).rigelfile
    if not arguments.chosen:
        for line in described(rigelfile.sequences):
            say(line)
        if not rigelfile.sequences:
            tell(f"{arguments.rigelfile}: has no sequences; docs/rigel-bridge.md shows where they are written")
        return Exit.OK
    for name in arguments.chosen:
        if name not in rigelfile.sequences:
            known = list(rigelfile.sequences)
            raise rigelfile.node.fail(
                f"there is no sequence {name}{nearest(name, known)}; sequences: {', '.join(known) or 'none'}"
            )
    found = {name: _of_sequence(arguments, name) for name in dict.fromkeys(arguments.chosen)}
    plans = {name: _planned(each, name, no_build=arguments.no_build) for name, each in found.items()}
    folder = arguments.results or Path("results") / datetime.now(tz=UTC).strftime("%Y%m%dT%H%M%SZ")
    folders = {name: folder / folder_name(rigelfile, name) for name in found}
    tools = _tools(arguments)
    with ended_like_ctrl_c():
        for name, each in found.items():
            run(name, plans[name], each, tools, opened(folders[name]))
    say(f"results: {folder}")
    return _compared(folder)


def _of_sequence(arguments: argparse.Namespace, name: str) -> Objects:
    source = source_of(arguments)
    found = objects(replace(source, options=replace(source.options, sequence=name, job="")))
    tell_notes(found.notes, arguments)
    return found


def _planned(found: Objects, name: str, *, no_build: bool) -> list[Action]:
    wanted = actions(found.rigelfile, name)
    if no_build:
        return [action for action in wanted if action.kind is Kind.DEPLOY]
    refuse_thesis(found.rigelfile, wanted)
    return wanted


def _tools(arguments: argparse.Namespace) -> Tools:
    done: set[tuple[str, ...]] = set()
    folder = arguments.rigelfile.resolve().parent

    def rigel(words: Sequence[str]) -> None:
        """Each job once: all sequences run the same image, or their figures could not be compared."""
        command = ["--load" if word == "--push" and arguments.load else word for word in words]
        if tuple(command) in done:
            tell(f"rigel {' '.join(command)}: done before")
            return
        run_rigel(command, folder=folder, timeout_s=arguments.build_timeout)
        done.add(tuple(command))

    limits = Limits(ready_s=arguments.wait, duration_s=arguments.duration)
    return Tools(kubectl_of(arguments), rigel, tell, Clock(), limits, keep=arguments.keep, run_id=uuid4().hex)


def run_rigel(arguments: Sequence[str], *, folder: Path, timeout_s: float, program: str = "rigel") -> None:
    """Run `rigel ARGUMENTS` to its end; BridgeError (STEP_FAILED) when it is missing, fails or takes too long.

    Rigel 0.3 ends a parallel stage with 0 whatever failed in it; its single jobs end with 1, and only these are run here.
    """
    found = shutil.which(program)
    shown = f"{program} {' '.join(arguments)}"
    if found is None:
        raise _failed(
            f"{program} is not an installed program, and the sequence needs `{shown}`: install Rigel (docs/rigel-bridge.md), or "
            "add --no-build when the image is in the registry already"
        )
    try:
        done = subprocess.run([found, *arguments], cwd=folder, timeout=timeout_s, check=False, stdin=subprocess.DEVNULL)
    except subprocess.TimeoutExpired:
        raise _failed(f"`{shown}` did not end within {timeout_s:g} s; --build-timeout allows more") from None
    except OSError as error:
        raise _failed(f"`{shown}` cannot be started: {error.strerror}") from error
    if done.returncode:
        raise _failed(f"`{shown}` ended with {done.returncode}; what it wrote stands above")


def _failed(message: str) -> BridgeError:
    return BridgeError(Place("rigel"), message, code=Exit.STEP_FAILED)


def _compared(folder: Path) -> int:
    runs: list[dict[str, Any]] = read_summaries(folder)
    if runs:
        sys.stdout.write(table(runs))
    else:
        tell(f"{folder}: holds no results of a run")
    for each in runs:
        if each.get("outcome") == UNFINISHED:
            name = each.get("app", "APP")
            tell(f"{each['sequence']}: its run goes on, or was killed; `rigel-bridge status {name}` shows which")
    return Exit.OK if runs and all(each.get("outcome") == "ran" for each in runs) else Exit.STEP_FAILED


SEQUENCES: Final = Verb(
    name="sequences",
    summary="list, run and compare the sequences of a Rigelfile",
    description=(
        "Run sequences such as demo, benchmark_default and benchmark_custom: Rigel's own jobs in their order, then the app under a "
        "name of its own (teleop-benchmark-default), which works for a while, leaves its results in a folder and is removed, also "
        "after a failure or Ctrl-C. The runs are shown side by side."
    ),
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge sequences", "lists them"),
        ("rigel-bridge sequences --run demo", "builds, runs, collects, removes"),
        ("rigel-bridge sequences --run benchmark_default benchmark_custom --duration 2m", "compares two schedulers"),
        ("rigel-bridge sequences --run demo --no-build", "the image is in the registry already"),
        ("rigel-bridge sequences --compare results/20261122T120000Z", "shows runs side by side again"),
    ),
)
