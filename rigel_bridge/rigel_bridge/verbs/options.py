"""Flags that all commands with a Rigelfile share."""

import argparse
import os
import re
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigel_bridge.document.failures import BridgeError, Exit, Place, printable
from rigel_bridge.generations.model import Options
from rigel_bridge.source import Objects, Source, objects

_NAMESPACE: Final = re.compile(r"[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?")


def add_source(parser: argparse.ArgumentParser, *, with_choice: bool = True) -> None:
    """The Rigelfile and how it is read: `objects_of` reads it. `with_choice`: one job or sequence of it can be chosen."""
    parser.add_argument(
        "rigelfile",
        nargs="?",
        type=Path,
        default=Path("Rigelfile"),
        help="file to read, - for standard input (default: ./Rigelfile)",
    )
    parser.add_argument("--name", help="name of the RobotApp (default: from the file, else the folder's name)")
    parser.add_argument(
        "-n",
        "--namespace",
        type=namespace,
        help="its namespace (default: none, never the file's: kubectl's own decides)",
    )
    parser.add_argument(
        "--env",
        action="append",
        default=[],
        type=_variable,
        metavar="NAME",
        help="take {{ NAME }} from the environment when it is not in vars; once per variable (default: none is taken)",
    )
    if with_choice:
        _add_choice(parser)
    else:
        parser.set_defaults(job="", sequence="")
    parser.add_argument(
        "--orchestration",
        type=Path,
        metavar="FILE",
        help="a second file with orchestration, sequences, application or vars, for a Rigel that refuses them in the first",
    )
    parser.add_argument(
        "--profile",
        type=Path,
        metavar="PATH",
        help="sources of the packages: what the file leaves open about scheduling is inferred from them, and marked",
    )
    parser.add_argument("--image", default="", help="image of the application, for files that name none or another")
    parser.add_argument("--distro", default="", help="ROS distribution, for files that name none or another")
    parser.add_argument("--strict", action="store_true", help="do nothing and fail with 72 when there is a note")


def _add_choice(parser: argparse.ArgumentParser) -> None:
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument("--job", default="", help="the job to render (default: the first with an orchestration block)")
    chosen.add_argument("--sequence", default="", help="every job of this sequence that deploys, with its overrides")


def source_of(arguments: argparse.Namespace) -> Source:
    """What the arguments of `add_source` name."""
    return Source(
        path=arguments.rigelfile,
        name=arguments.name,
        namespace=arguments.namespace,
        orchestration=arguments.orchestration,
        profile=arguments.profile,
        today=datetime.now(tz=UTC).date().isoformat(),
        options=Options(
            environment={name: os.environ[name] for name in arguments.env},
            job=arguments.job,
            sequence=arguments.sequence,
            image=arguments.image,
            distro=arguments.distro,
        ),
    )


def objects_of(arguments: argparse.Namespace) -> Objects:
    """The objects that the arguments of `add_source` name. Notes go to standard error; with --strict they are an error."""
    source = source_of(arguments)
    found = objects(source)
    tell_notes(found.notes, arguments)
    return found


def tell_notes(notes: Iterable[str], arguments: argparse.Namespace) -> None:
    """Notes to standard error; with --strict they are an error."""
    listed = tuple(notes)
    for note in listed:
        sys.stderr.write(f"note: {printable(note)}\n")
    if listed and arguments.strict:
        raise BridgeError(Place(str(arguments.rigelfile)), "has notes, and --strict allows none", code=Exit.INVALID)


def namespace(text: str) -> str:
    """An argument of --namespace. Raises what argparse turns into wrong usage."""
    if not _NAMESPACE.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no name of a namespace; allowed: up to 63 lower-case letters, digits and dashes, for example fleet"
        )
    return text


def _variable(name: str) -> str:
    if name not in os.environ:
        raise argparse.ArgumentTypeError(f"{name}: this variable is not set; set it, or leave the flag out")
    return name
