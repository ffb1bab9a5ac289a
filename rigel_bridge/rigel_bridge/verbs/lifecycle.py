"""`rigel-bridge apply`, `diff`, `rollback`, `delete`: a RobotApp into the cluster, back to an earlier spec, and away."""

import argparse
import functools
import re
import sys
from typing import Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.deployment import Proposal, deploy, roll_back
from rigel_bridge.cluster.differences import diff
from rigel_bridge.cluster.kubectl import ClusterError
from rigel_bridge.cluster.removal import remove
from rigel_bridge.cluster.volume_claims import apply_claims, delete_claims
from rigel_bridge.cluster.waiting import Clock, wait_ready
from rigel_bridge.document.failures import Exit, printable
from rigel_bridge.verbs.cluster_options import add_app, add_cluster, kubectl_of, names_of, say, seconds, subject, tell
from rigel_bridge.verbs.options import add_source, objects_of
from rigel_bridge.verbs.verb import Verb


def _apply_arguments(parser: argparse.ArgumentParser) -> None:
    add_source(parser)
    parser.add_argument(
        "--wait", type=seconds, metavar="DURATION", help="return when the app is Ready, at the latest after this time"
    )
    add_cluster(parser)


def _apply(arguments: argparse.Namespace) -> int:
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
    arguments=_apply_arguments,
    run=_apply,
    examples=(
        ("rigel-bridge apply --wait 2m", "until the app is Ready"),
        ("rigel-bridge apply -n fleet ws/Rigelfile", "into a namespace"),
        ("rigel-bridge diff && rigel-bridge apply", "look first"),
    ),
)


def _diff_arguments(parser: argparse.ArgumentParser) -> None:
    add_source(parser)
    add_cluster(parser)


def _diff(arguments: argparse.Namespace) -> int:
    kubectl, code = kubectl_of(arguments), Exit.OK
    for app in objects_of(arguments).apps:
        name = app["metadata"]["name"]
        stored = apps.read(kubectl, name) or {"spec": {}}
        wanted = apps.apply(kubectl, app, dry_run=True)
        text = diff(stored["spec"], wanted["spec"], before=f"cluster/{name}", after=f"rigelfile/{name}")
        if text:
            code = Exit.DIFFERENT
            sys.stdout.writelines(f"{printable(line)}\n" for line in text.splitlines())
    return code


DIFF: Final = Verb(
    name="diff",
    summary="show what apply would change",
    description=(
        "Compare the stored spec with what `apply` would make of it; nothing is written. Empty and exit code 0 when they are "
        "equal, 1 when they differ."
    ),
    arguments=_diff_arguments,
    run=_diff,
    examples=(
        ("rigel-bridge diff", "what `apply` of ./Rigelfile would change"),
        ("rigel-bridge diff -n fleet ws/Rigelfile", "in a namespace"),
    ),
)


def _rollback_arguments(parser: argparse.ArgumentParser) -> None:
    add_app(parser)
    parser.add_argument(
        "--to", type=_revision, metavar="N", help="revision to go back to (default: the last other spec); see status"
    )
    parser.add_argument(
        "--wait", type=seconds, metavar="DURATION", help="return when the app is Ready, at the latest then"
    )
    parser.add_argument(
        "--yes",
        action="store_true",
        help="do not ask before an image, account or Secret is added that the app has not now",
    )


def _revision(text: str) -> int:
    if not re.fullmatch("[1-9][0-9]{0,8}", text):
        raise argparse.ArgumentTypeError(f"{text[:80]!r} is no number of a revision; `rigel-bridge status` lists them")
    return int(text)


def _rollback(arguments: argparse.Namespace) -> int:
    kubectl = kubectl_of(arguments)
    for name in names_of(arguments):
        approve = functools.partial(_approve, assume_yes=arguments.yes)
        written, number = roll_back(kubectl, name, number=arguments.to, approve=approve, tell=tell)
        say(f"{subject(written.stored)}: {written.outcome}, spec of revision {number}")
        for change in written.changes:
            say(f"  {change}")
        if arguments.wait is not None:
            wait_ready(kubectl, name, timeout_s=arguments.wait, clock=Clock(), tell=tell)
            say(f"{subject(written.stored)}: Ready")
    return Exit.OK


def _approve(proposal: Proposal, *, assume_yes: bool) -> None:
    """Shows the difference, and asks before something is added that runs, or that is run with. Raises ClusterError after a no."""
    sys.stdout.writelines(f"{printable(line)}\n" for line in proposal.diff.splitlines())
    if not proposal.additions or assume_yes:
        return
    say(f"revision {proposal.number} adds:")
    for line in proposal.additions:
        say(f"  {line}")
    if sys.stdin.isatty():
        say(f"give robotapp/{proposal.name} this spec? [y/N]")
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    raise ClusterError(
        f"RobotApp {proposal.name}: revision {proposal.number} adds what is listed above and nobody said yes, so nothing is written; "
        "look at the difference, then repeat with --yes",
        code=Exit.DIFFERENT,
    )


ROLLBACK: Final = Verb(
    name="rollback",
    summary="give the app an earlier spec",
    description=(
        "Give the app the spec of an earlier revision, byte for byte: also what others changed since is undone. The difference is "
        "shown first, and you are asked before an image, an account or a Secret is added: whoever may write apps of the namespace "
        "may write its revisions. The present spec becomes a revision first, so a second rollback returns to it."
    ),
    arguments=_rollback_arguments,
    run=_rollback,
    examples=(
        ("rigel-bridge rollback", "the spec before the last change; again to return"),
        ("rigel-bridge status amr-teleop", "lists the revisions"),
        ("rigel-bridge rollback amr-teleop --to 3", "one of them"),
        ("rigel-bridge rollback --yes", "without a question, in a script"),
    ),
)


def _delete_arguments(parser: argparse.ArgumentParser) -> None:
    add_app(parser)
    parser.add_argument(
        "--storage", action="store_true", help="delete the volume claims that apply made for it, with their data"
    )
    parser.add_argument(
        "--wait", type=seconds, default=120.0, metavar="DURATION", help="longest time until all is gone (default: 2m)"
    )


def _delete(arguments: argparse.Namespace) -> int:
    kubectl = kubectl_of(arguments)
    for name in names_of(arguments):
        there = remove(kubectl, name, timeout_s=arguments.wait, clock=Clock())
        say(f"robotapp/{name}: {'deleted, with its pods and its history' if there else 'is not there'}")
        for claim in delete_claims(kubectl, name) if arguments.storage else ():
            say(f"persistentvolumeclaim/{claim}: deleted")
    return Exit.OK


DELETE: Final = Verb(
    name="delete",
    summary="delete the app, its pods and its history",
    description=(
        "Delete the RobotApp and return when nothing of it is left. Volume claims, ConfigMaps and whatever else it only names "
        "stay. An app that is not there is no error."
    ),
    arguments=_delete_arguments,
    run=_delete,
    examples=(
        ("rigel-bridge delete", "what ./Rigelfile became; volume claims stay"),
        ("rigel-bridge delete amr-teleop -n fleet --wait 5m", "an app by its name"),
        ("rigel-bridge delete amr-teleop --storage", "with its data"),
    ),
)
