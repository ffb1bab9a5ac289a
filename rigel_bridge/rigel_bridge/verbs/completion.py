"""`rigel-bridge completion`: TAB in bash, zsh and fish. The shell runs `rigel-bridge __complete WORD…` and reads one candidate per line."""

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from rigel_bridge.cluster.kubectl import Kubectl
from rigel_bridge.document.failures import BridgeError, Exit
from rigel_bridge.generations.load import Outline
from rigel_bridge.names import APPS
from rigel_bridge.source import STANDARD_INPUT, Source, examine, read_bytes
from rigel_bridge.verbs.verb import Verb

CALL: Final = "__complete"
"""The first word of what the shells run; it is in no help."""
_PATIENCE_S: Final = 2.0
"""For the names of apps: the shell waits meanwhile."""
_WORD: Final = re.compile(r"[-\w./:@+]+", re.ASCII)
"""What is offered: a name with other characters, from a file of somebody else, would be a command where the shell puts it."""
_SCRIPTS: Final[Mapping[str, str]] = {
    "bash": """\
_rigel_bridge() {
  local IFS=$'\\n'
  COMPREPLY=($(rigel-bridge __complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null | cut -f1))
}
complete -o default -F _rigel_bridge rigel-bridge
""",
    "zsh": """\
#compdef rigel-bridge
_rigel_bridge() {
  local -a found
  found=(${(f)"$(rigel-bridge __complete "${(@)words[2,CURRENT]}" 2>/dev/null | cut -f1)"})
  if (( $#found )); then compadd -- $found; else _files; fi
}
compdef _rigel_bridge rigel-bridge
""",
    "fish": """\
function __rigel_bridge
  set -l found (rigel-bridge __complete (commandline -opc)[2..-1] (commandline -ct) 2>/dev/null)
  if test (count $found) -gt 0
    printf '%s\\n' $found
  else
    __fish_complete_path (commandline -ct)
  end
end
complete -c rigel-bridge -f -a '(__rigel_bridge)'
""",
}


@dataclass(frozen=True, slots=True)
class _Line:
    """What stands on the command line between the command and the word that is being typed."""

    flags: Mapping[str, argparse.Action]
    positionals: Sequence[argparse.Action]
    words: Sequence[str]

    @classmethod
    def of(cls, parser: argparse.ArgumentParser, words: Sequence[str]) -> "_Line":
        actions = parser._actions  # noqa: SLF001 - argparse has no other list
        flags = {flag: action for action in actions for flag in action.option_strings}
        return cls(flags, [action for action in actions if not action.option_strings], words)

    def pending(self, words: Sequence[str]) -> argparse.Action | None:
        """The option whose value comes after `words`: the one in front, or an earlier one that takes several values."""
        for distance, word in enumerate(reversed(words)):
            if _is_flag(word):
                action = self.flags.get(word)
                several = action is not None and action.nargs == "+"
                return action if action is not None and action.nargs != 0 and (several or not distance) else None
        return None

    def arguments(self) -> list[str]:
        """The words that are neither flags nor their values."""
        return [
            word
            for index, word in enumerate(self.words)
            if not _is_flag(word) and self.pending(self.words[:index]) is None
        ]

    def value(self, *flags: str) -> str | None:
        return next((value for flag, value in pairwise(self.words) if flag in flags), None)


def _is_flag(word: str) -> bool:
    return word.startswith("-") and word != str(STANDARD_INPUT)


def write_candidates(
    parser: argparse.ArgumentParser,
    commands: Mapping[str, argparse.ArgumentParser],
    words: Sequence[str],
    *,
    summaries: Mapping[str, str],
) -> int:
    """One line per candidate for the last of `words`: the word, a tab, its help. No line: the shell offers names of files."""
    *before, typed = [word for word in words[:-1] if word != "="] + [word.lstrip("=") for word in words[-1:] or [""]]
    command = next((word for word in before if word in commands), "")
    if command:
        found = _of_command(_Line.of(commands[command], before[before.index(command) + 1 :]), typed)
    elif typed.startswith("-"):
        found = _flags(_Line.of(parser, ()))
    else:
        found = iter(summaries.items())
    for word, text in found:
        if word.startswith(typed) and _WORD.fullmatch(word):
            sys.stdout.write(f"{word}\t{text.partition('. ')[0]}\n")
    return Exit.OK


def _flags(line: _Line) -> Iterator[tuple[str, str]]:
    yield from ((flag, action.help or "") for flag, action in line.flags.items())


def _of_command(line: _Line, typed: str) -> Iterator[tuple[str, str]]:
    if typed.startswith("-"):
        yield from _flags(line)
        return
    number = len(line.arguments())
    action = line.pending(line.words) or next(iter(line.positionals[number : number + 1]), None)
    if action is None:
        return
    if action.choices:
        yield from ((str(choice), "") for choice in action.choices)
    elif known := _OF_THE_FILE.get(action.dest):
        yield from ((name, "") for name in _outlined(line, known))
    elif action.dest == "app":
        yield from ((name, "RobotApp") for name in _apps(line))


_OF_THE_FILE: Final[Mapping[str, Callable[[Outline], Sequence[str]]]] = {
    "job": lambda found: found.jobs,
    "sequence": lambda found: found.sequences,
    "chosen": lambda found: found.sequences,
}
"""Values that stand in the Rigelfile, by the destination of their flag."""


def _outlined(line: _Line, known: Callable[[Outline], Sequence[str]]) -> Sequence[str]:
    path = Path(next(iter(line.arguments()), "Rigelfile"))
    if path == STANDARD_INPUT:
        return ()
    try:
        return known(examine(read_bytes(path), Source(path)))
    except BridgeError:
        return ()


def _apps(line: _Line) -> list[str]:
    """RobotApps of the namespace on the command line; none when the cluster does not answer at once."""
    stated = {"--context": line.value("--context"), "--kubeconfig": line.value("--kubeconfig")}
    stated["--namespace"] = line.value("-n", "--namespace")
    kubectl = Kubectl(
        line.value("--kubectl") or "kubectl", flags=[f"{flag}={value}" for flag, value in stated.items() if value]
    )
    try:
        listed = kubectl.run("get", APPS, "-o", "name", timeout_s=_PATIENCE_S)
    except BridgeError:
        return []
    return [each.rpartition("/")[2] for each in listed.splitlines()]


def _shell(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=tuple(_SCRIPTS), help="the shell that is to complete")


def _run(arguments: argparse.Namespace) -> int:
    sys.stdout.write(_SCRIPTS[arguments.shell])
    return Exit.OK


COMPLETION: Final = Verb(
    name="completion",
    summary="write the script that lets your shell complete on TAB",
    description=(
        "Write the script by which bash, zsh or fish completes commands, flags, the jobs and sequences of the Rigelfile and the "
        "RobotApps of the cluster."
    ),
    arguments=_shell,
    run=_run,
    examples=(
        ("source <(rigel-bridge completion bash)", "for this shell; in ~/.bashrc for every one"),
        ("source <(rigel-bridge completion zsh)", "the same, after compinit"),
        ("rigel-bridge completion fish | source", "the same in fish"),
    ),
)
