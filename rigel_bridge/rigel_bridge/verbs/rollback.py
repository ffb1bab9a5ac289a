"""`rigel-bridge rollback`: back to an earlier spec."""

import argparse
from typing import Final

from rigel_bridge.cluster.deployment import roll_back
from rigel_bridge.cluster.waiting import Clock, wait_ready
from rigel_bridge.document.failures import Exit
from rigel_bridge.verbs.cluster_options import add_app, kubectl_of, names_of, say, seconds, subject, tell
from rigel_bridge.verbs.verb import Verb


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_app(parser)
    parser.add_argument(
        "--to", type=int, metavar="N", help="revision to go back to (default: the last other spec); see status"
    )
    parser.add_argument(
        "--wait", type=seconds, metavar="DURATION", help="return when the app is Ready, at the latest then"
    )


def _run(arguments: argparse.Namespace) -> int:
    kubectl = kubectl_of(arguments)
    for name in names_of(arguments):
        written, number = roll_back(kubectl, name, number=arguments.to, tell=tell)
        say(f"{subject(written.stored)}: {written.outcome}, spec of revision {number}")
        for change in written.changes:
            say(f"  {change}")
        if arguments.wait is not None:
            wait_ready(kubectl, name, timeout_s=arguments.wait, clock=Clock(), tell=tell)
            say(f"{subject(written.stored)}: Ready")
    return Exit.OK


ROLLBACK: Final = Verb(
    name="rollback",
    summary="give the app an earlier spec",
    description=(
        "Give the app the spec of an earlier revision, byte for byte: also what others changed since is undone. The present "
        "spec becomes a revision first, so a second rollback returns to it."
    ),
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge rollback", "the spec before the last change; again to return"),
        ("rigel-bridge status amr-teleop", "lists the revisions"),
        ("rigel-bridge rollback amr-teleop --to 3", "one of them"),
    ),
)
