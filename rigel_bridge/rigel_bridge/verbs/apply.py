"""`rigel-bridge apply`: the RobotApp of a Rigelfile into the cluster."""

import argparse
from typing import Final

from rigel_bridge.cluster.deployment import deploy
from rigel_bridge.cluster.volume_claims import apply_claims
from rigel_bridge.cluster.waiting import Clock, wait_ready
from rigel_bridge.document.failures import Exit
from rigel_bridge.verbs.cluster_options import add_cluster, kubectl_of, say, seconds, subject, tell
from rigel_bridge.verbs.options import add_source, objects_of
from rigel_bridge.verbs.verb import Verb


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_source(parser)
    parser.add_argument(
        "--wait", type=seconds, metavar="DURATION", help="return when the app is Ready, at the latest after this time"
    )
    add_cluster(parser)


def _run(arguments: argparse.Namespace) -> int:
    kubectl = kubectl_of(arguments)
    found = objects_of(arguments)
    for claim in apply_claims(kubectl, found.claims):
        say(f"persistentvolumeclaim/{claim}: applied")
    written = []
    for app in found.apps:  # each is told at once: when a later one is refused, the earlier ones are written
        each = deploy(kubectl, app, tell=tell)
        written.append(each)
        say(f"{subject(each.stored)}: {each.outcome}")
        for change in each.changes:
            say(f"  {change}")
    if arguments.wait is not None:
        clock = Clock()
        for each in written:
            wait_ready(kubectl, each.stored["metadata"]["name"], timeout_s=arguments.wait, clock=clock, tell=tell)
            say(f"{subject(each.stored)}: Ready")
    return Exit.OK


APPLY: Final = Verb(
    name="apply",
    summary="write the RobotApp into the cluster",
    description=(
        "Write the RobotApp of a Rigelfile into the cluster with your own kubectl and your own rights. What an earlier apply "
        "wrote and this file no longer has is taken back; what others set beside it (suspend, for one) stays. The spec that is "
        "replaced is kept as a ControllerRevision for `rollback`, ten of them at most."
    ),
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge apply --wait 2m", "until the app is Ready"),
        ("rigel-bridge apply -n fleet ws/Rigelfile", "into a namespace"),
        ("rigel-bridge diff && rigel-bridge apply", "look first"),
    ),
)
