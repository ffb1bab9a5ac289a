"""`rigel-bridge`: the command line."""

import argparse
import hashlib
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml

from rigel_bridge import __version__
from rigel_bridge.document import STANDARD_INPUT, parse, read_bytes
from rigel_bridge.failures import BridgeError, Exit, Place, printable
from rigel_bridge.render import render
from rigel_bridge.rigelfile import load

_NAMESPACE = re.compile(r"[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?")
_EXAMPLES = """\
examples:
  rigel-bridge render                                    the Rigelfile of this folder, to the screen
  rigel-bridge render ws/Rigelfile | kubectl apply -f -  straight to the cluster
  git show v1:Rigelfile | rigel-bridge render - --name amr-teleop
  rigel-bridge render --name amr-teleop -n fleet -o k8s/teleop.yaml
  TAG=1.4.0 rigel-bridge render --env TAG                {{ TAG }} from the environment, and nothing else

exit codes:
  0 done   2 wrong usage   70 file unreadable   71 not the YAML we accept
  72 the Rigelfile says something impossible   73 a Rigelfile of another generation

Errors are one line: file:line: what is wrong; what is allowed. Notes go to standard error as well.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if unset := [name for name in arguments.env if name not in os.environ]:
        parser.error(f"--env {unset[0]}: this variable is not set; set it, or leave the flag out")
    try:
        text, notes = _render(arguments)
        for note in notes:
            sys.stderr.write(f"note: {printable(note)}\n")
        if notes and arguments.strict:
            return Exit.INVALID
        _write(text, arguments.output)
    except BridgeError as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return error.code
    except BrokenPipeError:  # `| head` closed the pipe: nothing more to say
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return Exit.OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rigel-bridge",
        description="Turn a Rigelfile into a RobotApp for Kubernetes.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"rigel-bridge {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    command = commands.add_parser(
        "render",
        help="write the RobotApp as YAML",
        description="Write the RobotApp of a Rigelfile (the format of Rigel 0.2) as YAML.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument(
        "rigelfile",
        nargs="?",
        type=Path,
        default=Path("Rigelfile"),
        help="file to read, - for standard input (default: ./Rigelfile)",
    )
    command.add_argument("--name", help="name of the RobotApp (default: from the file, else the folder's name)")
    command.add_argument(
        "-n",
        "--namespace",
        type=_namespace,
        help="its namespace (default: none, never the file's: kubectl's own decides)",
    )
    command.add_argument("-o", "--output", type=Path, help="file to write instead of standard output")
    command.add_argument(
        "--env",
        action="append",
        default=[],
        metavar="NAME",
        help="take {{ NAME }} from the environment when it is not in vars; once per variable (default: none is taken)",
    )
    command.add_argument("--strict", action="store_true", help="write nothing and fail with 72 when there is a note")
    return parser


def _namespace(text: str) -> str:
    """An argument of --namespace. Raises what argparse turns into wrong usage."""
    if not _NAMESPACE.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no name of a namespace; allowed: up to 63 lower-case letters, digits and dashes, for example fleet"
        )
    return text


def _render(arguments: argparse.Namespace) -> tuple[str, tuple[str, ...]]:
    path: Path = arguments.rigelfile
    data = read_bytes(path)
    shown = "standard input" if path == STANDARD_INPUT else str(path)
    rigelfile = load(parse(data, shown), {allowed: os.environ[allowed] for allowed in arguments.env})
    rendered = render(
        rigelfile,
        name=arguments.name or path.resolve().parent.name,
        override=arguments.name is not None,
        namespace=arguments.namespace,
        provenance={
            "generation": "g1",
            "rigelfile-sha256": hashlib.sha256(data).hexdigest(),
            "bridge-version": __version__,
        },
    )
    return yaml.safe_dump(rendered.app, sort_keys=False, allow_unicode=True, width=120), rendered.notes


def _write(text: str, output: Path | None) -> None:
    try:
        if output is None:
            sys.stdout.write(text)
            sys.stdout.flush()
        else:
            output.write_text(text, encoding="utf-8")
    except BrokenPipeError:
        raise
    except OSError as error:
        place = Place(str(output or "standard output"))
        raise BridgeError(place, f"cannot be written: {error.strerror}", code=Exit.UNREADABLE) from error


if __name__ == "__main__":
    sys.exit(main())
