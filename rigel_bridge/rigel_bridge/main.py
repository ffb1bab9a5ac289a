"""`rigel-bridge`: the command line."""

import argparse
import os
import sys
from collections.abc import Sequence

from rigel_bridge import __version__
from rigel_bridge.document.failures import BridgeError, Exit, printable
from rigel_bridge.verbs.table import VERBS

_EXAMPLES = """\
examples:
  rigel-bridge render                                    the Rigelfile of this folder, to the screen
  rigel-bridge render ws/Rigelfile | kubectl apply -f -  straight to the cluster
  git show v1:Rigelfile | rigel-bridge render - --name amr-teleop
  rigel-bridge render --name amr-teleop -n fleet -o k8s/teleop.yaml
  rigel-bridge render --sequence benchmark_default       Rigel 0.3: the jobs of a sequence that deploy
  rigel-bridge apply --wait 2m                           the same, with history, until it is Ready
  TAG=1.4.0 rigel-bridge render --env TAG                {{ TAG }} from the environment, and nothing else

exit codes:
  0 done   2 wrong usage   70 file unreadable   71 not the YAML we accept
  72 the Rigelfile says something impossible   73 no generation of Rigelfile
  74 no kubectl, no connection, or the cluster refused   75 not Ready or not gone in time
  76 no such app or past spec   77 a job of a sequence failed   130 Ctrl-C; `diff` ends with 1 when it finds a difference

Errors are one line: file:line: what is wrong; what is allowed. Notes go to standard error as well.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except BridgeError as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return error.code
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return Exit.INTERRUPTED
    except BrokenPipeError:  # `| head` closed the pipe: nothing more to say
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Exit.OK
    except OSError as error:  # a full disk behind `>`: what was written is not all
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        place = error.filename or "standard output"
        sys.stderr.write(f"{printable(str(place))}: cannot be read or written: {error.strerror}\n")
        return Exit.UNREADABLE
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rigel-bridge",
        description="Turn a Rigelfile into a RobotApp for Kubernetes.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"rigel-bridge {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for verb in VERBS:
        command = commands.add_parser(
            verb.name,
            help=verb.summary,
            description=verb.description,
            epilog=_EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        verb.arguments(command)
        command.set_defaults(run=verb.run)
    return parser


if __name__ == "__main__":
    sys.exit(main())
