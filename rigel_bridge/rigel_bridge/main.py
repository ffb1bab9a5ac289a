"""`rigel-bridge`: the command line."""

import argparse
import os
import re
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NoReturn

from rigel_bridge import __version__
from rigel_bridge.document.failures import BridgeError, Exit, nearest, printable
from rigel_bridge.verbs.completion import CALL, write_candidates
from rigel_bridge.verbs.table import VERBS

_EXIT_CODES: Final = """\
exit codes:
  0 done   1 `diff` found a difference   2 wrong usage   70 file unreadable
  71 not the YAML we accept   72 the Rigelfile says something impossible
  73 no generation of Rigelfile   75 not Ready or not gone in time
  74 no kubectl, no connection, or the cluster refused
  76 no such app or past spec   77 a job of a sequence failed   130 Ctrl-C

Errors are one line: file:line: what is wrong; what is allowed. Notes go to
standard error as well.
"""
_WIDTH: Final = 74
"""Characters for an example and its effect, in a terminal of 80 columns."""
_LONGEST_NAME: Final = max(len(verb.name) for verb in VERBS) + 4
"""With its indentation, of which argparse takes no account."""
_NO_COMMAND: Final = re.compile(r"argument COMMAND: invalid choice: '(.*)' \(choose from")
_FIRST: Final = ("render", "check", "apply", "sequences", "migrate")
"""Commands whose first example stands in `rigel-bridge --help`."""


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    words = sys.argv[1:] if argv is None else argv
    run = partial(_complete, words[1:]) if words[:1] == [CALL] else _chosen(words)
    try:
        code = run()
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


def _complete(words: Sequence[str]) -> int:
    return write_candidates(*_parser(), words, summaries={verb.name: verb.summary for verb in VERBS})


def _chosen(argv: Sequence[str]) -> Callable[[], int]:
    """The command that was typed, with its arguments."""
    arguments = _arguments(argv)
    return partial(arguments.run, arguments)


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    """What was typed. A flag that is not known is told by the command it was given to, with the nearest one."""
    parser, commands = _parser()
    arguments, unknown = parser.parse_known_args(argv)
    if len(unknown) == 1 and not unknown[0].startswith("-") and getattr(arguments, "app", "") is None:
        arguments.app = unknown.pop()  # `collect FOLDER -n fleet APP`: argparse takes no optional name after a flag
    if unknown:
        command = commands[arguments.command]
        flags = [flag for action in command._actions for flag in action.option_strings]  # noqa: SLF001 - argparse has no other list
        command.error(f"{unknown[0]} is not known here{nearest(unknown[0].partition('=')[0], flags)}")
    return arguments


def _parser() -> tuple["_Parser", dict[str, "_Parser"]]:
    first = [verb.examples[0] for verb in VERBS if verb.name in _FIRST]
    parser = _Parser(
        prog="rigel-bridge",
        description="Turn a Rigelfile into a RobotApp for Kubernetes. `rigel-bridge COMMAND --help` has the flags and examples of each.",
        epilog=_epilog(first),
        formatter_class=_Help,
    )
    parser.add_argument("--version", action="version", version=f"rigel-bridge {__version__}")
    added = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands = {}
    for verb in VERBS:
        command = added.add_parser(
            verb.name,
            help=verb.summary,
            description=verb.description,
            epilog=_epilog(verb.examples),
            formatter_class=_Help,
        )
        verb.arguments(command)
        command.set_defaults(run=verb.run)
        commands[verb.name] = command
    return parser, commands


class _Parser(argparse.ArgumentParser):
    """Wrong usage is one line, as every other mistake is: argparse would print all flags before it."""

    def error(self, message: str) -> NoReturn:
        if found := _NO_COMMAND.match(message):
            message = f"there is no command {found[1]}{nearest(found[1], [verb.name for verb in VERBS])}"
        if message.endswith("required: COMMAND"):
            message = "a command is missing"
        self.exit(Exit.USAGE, f"{self.prog}: error: {printable(message)}; `{self.prog} --help` shows what is allowed\n")


class _Help(argparse.RawDescriptionHelpFormatter):
    """Descriptions are filled to the terminal; examples and exit codes stand as they are written."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = _LONGEST_NAME

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith("examples:"):
            return super()._fill_text(text, width, indent)
        return argparse.HelpFormatter._fill_text(self, text, width, indent)  # noqa: SLF001 - the base class of the formatter


def _epilog(examples: Sequence[tuple[str, str]]) -> str:
    """Examples with what they do beside them, or below where one of them does not fit."""
    widest = max(len(line) for line, _ in examples)
    between = "  " if widest + max(len(effect) for _, effect in examples) <= _WIDTH else "\n      "
    lines = [f"  {line:<{0 if between.strip(' ') else widest}}{between}{effect}" for line, effect in examples]
    return "\n".join(["examples:", *lines, "", _EXIT_CODES])


if __name__ == "__main__":
    sys.exit(main())
