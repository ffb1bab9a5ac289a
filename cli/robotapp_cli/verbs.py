"""The group of verbs: options before the verb, --version, and the right command for verbs that people guess."""

from collections.abc import Sequence
from importlib.metadata import version
from itertools import pairwise, takewhile
from typing import Any, Final

import typer
from typer.core import TyperGroup

ANSWERS: Final = {
    "get": "kubectl get ra, or kubectl robotapp list",
    "ls": "kubectl robotapp list",
    "status": "kubectl robotapp info NAME",
    "show": "kubectl robotapp info NAME",
    "describe": "kubectl robotapp info NAME, or kubectl describe ra NAME for events alone",
    "events": "kubectl robotapp info NAME, or kubectl get events",
    "why": "kubectl robotapp explain NAME",
    "log": "kubectl robotapp logs NAME",
    "ssh": "kubectl robotapp shell NAME",
    "stop": "kubectl robotapp suspend NAME",
    "start": "kubectl robotapp resume NAME",
    "apply": "kubectl apply -f FILE (kubectl robotapp lint FILE checks it first)",
    "create": "kubectl apply -f FILE (kubectl robotapp lint FILE checks it first)",
    "run": "kubectl apply -f FILE (kubectl robotapp lint FILE checks it first)",
    "edit": "kubectl edit ra NAME",
    "delete": "kubectl delete ra NAME",
    "top": "kubectl top pods -l robotics.io/app=NAME, or kubectl robotapp nodes",
    "topics": "kubectl robotapp info NAME, which lists the edges with their topics and latency",
    "validate": "kubectl robotapp lint FILE",
    "check": "kubectl robotapp lint FILE",
    "ui": "kubectl robotapp console",
    "dashboard": "kubectl robotapp console",
    "version": "kubectl robotapp --version",
}
"""Verbs that are not ours → what to type. Checked against the commands by a test."""


VALUED_OPTIONS: Final = ("-n", "--namespace", "--context", "--kubeconfig", "-o", "--output")
"""Options with a value that may stand before the verb, as with kubectl."""
GROUPS: Final = ("bags",)
"""Verbs that consist of two words."""
PLAIN_OPTIONS: Final = ("-A", "--all-namespaces")


OPTION_ANSWERS: Final = {
    "-w": "kubectl get ra -w follows the apps, and kubectl robotapp console the fleet",
    "--watch": "kubectl get ra -w follows the apps, and kubectl robotapp console the fleet",
    "-o name": "kubectl get ra -o name lists names",
    "-l": "kubectl get ra -l KEY=VALUE chooses by labels",
    "--selector": "kubectl get ra -l KEY=VALUE chooses by labels",
}
"""Options of kubectl that none of our verbs has → the command that has it."""


class Verbs(TyperGroup):
    """The commands; an unknown one is answered with the command that does what its name says."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Moves options that kubectl takes before its verb behind the verb, where each command of ours has them."""
        return super().parse_args(ctx, move_options(args))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Returns the command that the first argument names. Raises a usage error with the answer for a known guess."""
        if args and args[0] not in self.commands and (answer := ANSWERS.get(args[0])):
            ctx.fail(f"there is no verb {args[0]}: use {answer}")
        if args and args[0] in self.commands and (option := _foreign_option(args[1:], self.commands[args[0]])):
            ctx.fail(f"{args[0]} has no {option}: {OPTION_ANSWERS[option]}")
        return super().resolve_command(ctx, args)


def move_options(arguments: Sequence[str]) -> list[str]:
    """Returns the arguments with such options behind the verb. Anything else before it stays, for typer to refuse.

    >>> move_options(["-n", "fleet", "list", "-o", "wide"])
    ['list', '-n', 'fleet', '-o', 'wide']
    >>> move_options(["-n", "fleet", "bags", "list", "patrol"])
    ['bags', 'list', '-n', 'fleet', 'patrol']
    """
    options: list[str] = []
    rest = list(arguments)
    while rest and (count := _count_words(rest[0])) and len(rest) > count:
        options += rest[:count]
        rest = rest[count:]
    words = 2 if rest and rest[0] in GROUPS else 1
    return [*rest[:words], *options, *rest[words:]]


def _count_words(word: str) -> int:
    """Returns how many arguments the option takes up that `word` begins; 0 if it begins none that may be moved."""
    if word in VALUED_OPTIONS:
        return 2
    is_joined = word.startswith(("--namespace=", "--context=", "--kubeconfig=", "--output="))
    is_short = word[:2] in ("-n", "-o") and len(word) > 2 and not word.startswith("--")
    return 1 if word in PLAIN_OPTIONS or is_joined or is_short else 0


def _foreign_option(words: Sequence[str], command: Any) -> str:
    """Returns the first option that the command lacks and another command has, "" without any. Words behind `--` are a program's."""
    words = list(takewhile(lambda word: word != "--", words))
    pairs = {f"{word} {value}" for word, value in pairwise(words)}
    if {"--output=name", "-oname"} & set(words) or {"-o name", "--output name"} & pairs:
        return "-o name"
    options = {option for parameter in command.params for option in parameter.opts}
    return next((word for word in words if word in OPTION_ANSWERS and word not in options), "")


def print_version(is_asked: bool) -> None:
    """Prints the version and ends, when --version is given."""
    if is_asked:
        typer.echo(f"kubectl-robotapp {version('robotapp')}")
        raise typer.Exit
