"""The group of verbs: --version, and for verbs that kubectl has, or people guess, the command that does it."""

from collections.abc import Sequence
from importlib.metadata import version
from itertools import pairwise
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
    "logs": "kubectl logs -l robotics.io/app=NAME,robotics.io/component=COMPONENT --all-containers --prefix -f",
    "exec": "kubectl exec -it deploy/DEPLOYMENT -- bash, with a name that kubectl get deploy -l robotics.io/app=NAME lists",
    "shell": "kubectl exec -it deploy/DEPLOYMENT -- bash, with a name that kubectl get deploy -l robotics.io/app=NAME lists",
    "apply": "kubectl apply -f FILE (kubectl robotapp lint FILE checks it first)",
    "create": "kubectl apply -f FILE (kubectl robotapp lint FILE checks it first)",
    "run": "kubectl apply -f FILE (kubectl robotapp lint FILE checks it first)",
    "edit": "kubectl edit ra NAME",
    "delete": "kubectl delete ra NAME",
    "suspend": """kubectl patch ra NAME --type merge -p '{"spec":{"suspend":true}}'""",
    "resume": """kubectl patch ra NAME --type merge -p '{"spec":{"suspend":false}}'""",
    "restart": "kubectl rollout restart deploy -l robotics.io/app=NAME",
    "top": "kubectl top pods -l robotics.io/app=NAME, or kubectl robotapp nodes",
    "topics": "kubectl robotapp info NAME, which lists the edges with their topics and latency",
    "validate": "kubectl robotapp lint FILE",
    "check": "kubectl robotapp lint FILE",
    "ui": "kubectl robotapp console",
    "dashboard": "kubectl robotapp console",
    "version": "kubectl robotapp --version",
}
"""Verbs that are not ours → what to type. Checked against the commands by a test."""


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

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Returns the command that the first argument names. Raises a usage error with the answer for a known guess."""
        if args and args[0] not in self.commands and (answer := ANSWERS.get(args[0])):
            ctx.fail(f"there is no verb {args[0]}: use {answer}")
        if args and args[0] in self.commands and (option := _foreign_option(args[1:])):
            ctx.fail(f"{args[0]} has no {option}: {OPTION_ANSWERS[option]}")
        return super().resolve_command(ctx, args)


def _foreign_option(words: Sequence[str]) -> str:
    """Returns the first option that is answered by another command, "" without any."""
    pairs = {f"{word} {value}" for word, value in pairwise(words)}
    if {"--output=name", "-oname"} & set(words) or {"-o name", "--output name"} & pairs:
        return "-o name"
    return next((word for word in words if word in OPTION_ANSWERS), "")


def print_version(is_asked: bool) -> None:
    """Prints the version and ends, when --version is given."""
    if is_asked:
        typer.echo(f"kubectl-robotapp {version('robotapp')}")
        raise typer.Exit
