"""`rigel-bridge migrate`: workloads of the thesis' time become RobotApps."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.kubectl import MAX_OUTPUT_BYTES, ClusterError, Kubectl, Refusal
from rigel_bridge.cluster.results import opened
from rigel_bridge.cluster.takeover import Limits, annotate, backup_name, forget, read, restorable, take_over
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.document.distros import distros
from rigel_bridge.document.failures import BridgeError, Exit, Place, nearest
from rigel_bridge.migration.found import config_maps_of, scene
from rigel_bridge.migration.report import Plan, annotation, document, leftover_records, lines, plan
from rigel_bridge.migration.shape import misshapen
from rigel_bridge.render.text import as_yaml
from rigel_bridge.verbs.cluster_options import add_cluster, ended_like_ctrl_c, kubectl_of, say, seconds, tell
from rigel_bridge.verbs.options import namespace
from rigel_bridge.verbs.verb import Verb

_ATTEMPTS: Final = 10
_SHOWN: Final = 200


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "workloads",
        nargs="*",
        help="names of Deployments or pods, also without annotations (default: all that have the thesis' annotations)",
    )
    parser.add_argument("-n", "--namespace", type=namespace, help="their namespace (default: kubectl's own)")
    parser.add_argument(
        "-A", "--all-namespaces", action="store_true", help="look into every namespace (not with --apply)"
    )
    parser.add_argument(
        "-f",
        "--file",
        type=Path,
        help="read `kubectl get deploy,rs,sts,ds,jobs,pods,nodes,cm -A -o json` from a file, without a cluster",
    )
    parser.add_argument("--distro", default="", help="ROS distribution of workloads whose image does not name one")
    parser.add_argument("--report", type=Path, help="write the report there as JSON as well")
    parser.add_argument(
        "--apply",
        action="store_true",
        help="replace the workloads: old ones end, RobotApps start, records of nodes are cleared",
    )
    parser.add_argument("--backup", type=Path, help="new folder for the old objects; required with --apply")
    parser.add_argument(
        "--lossy", action="store_true", help="apply also what loses fields or company (LOST and APART in the report)"
    )
    parser.add_argument(
        "--wait",
        type=seconds,
        default=120.0,
        metavar="DURATION",
        help="longest time until an app is Ready (default: 2m)",
    )
    add_cluster(parser)


def _run(arguments: argparse.Namespace) -> int:
    _refuse_contradictions(arguments)
    kubectl = kubectl_of(arguments)
    objects = (
        _of_file(arguments.file)
        if arguments.file
        else read(kubectl, everywhere=arguments.all_namespaces, tell=tell, config_maps_of=config_maps_of)
    )
    _refuse_missing(arguments.workloads, objects)
    found = plan(scene(objects, names=arguments.workloads), distro=arguments.distro, names=arguments.workloads)
    for line in lines(found):
        tell(line)
    if arguments.report:
        _write(arguments.report, json.dumps(document(found), indent=2) + "\n")
    if arguments.apply:
        with ended_like_ctrl_c():
            _take_over(kubectl, found, arguments)
    else:
        sys.stdout.write(as_yaml([made.app for made in found.apps]))
    if not found.apps:
        tell("nothing to migrate: no Deployment or pod has annotations scheduler.robotics.io/…, or all of them stay")
    return Exit.INVALID if found.refused else Exit.OK


def _refuse_contradictions(arguments: argparse.Namespace) -> None:
    if arguments.apply and (arguments.file or arguments.all_namespaces):
        raise _usage("--apply works on one namespace of the cluster: leave -A and -f out")
    if arguments.apply and not arguments.backup:
        raise _usage("--apply needs --backup FOLDER, where the old objects are kept")
    if arguments.distro and arguments.distro not in distros():
        hint = nearest(arguments.distro.lower(), list(distros()))
        raise _usage(f"--distro {arguments.distro[:80]!r} is no ROS distribution that we know{hint}")


def _refuse_missing(names: list[str], objects: list[dict[str, Any]]) -> None:
    """A slip in a name must not end as "nothing to migrate"."""
    known = [each["metadata"]["name"] for each in objects if each["kind"] in ("Deployment", "Pod")]
    for name in names:
        if name not in known:
            raise BridgeError(
                Place("migrate"), f"there is no Deployment or pod {name}{nearest(name, known)}", code=Exit.MISSING
            )


def _usage(message: str) -> BridgeError:
    return BridgeError(Place("migrate"), message, code=Exit.USAGE)


def _of_file(path: Path) -> list[dict[str, Any]]:
    """Objects of a List as kubectl writes it in JSON."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_OUTPUT_BYTES + 1)
        loaded: Any = json.loads(data) if len(data) <= MAX_OUTPUT_BYTES else None
        items = list(loaded["items"])
    except OSError as error:
        raise BridgeError(Place(str(path)), f"cannot be read: {error.strerror}", code=Exit.UNREADABLE) from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise BridgeError(
            Place(str(path)),
            "is no List of objects in JSON of at most 16 MiB, as kubectl get -o json writes it",
            code=Exit.SYNTAX,
        ) from error
    for index, item in enumerate(items):
        if (where := misshapen(item)) is not None:
            raise BridgeError(
                Place(str(path)),
                f"items[{index}]{where[:_SHOWN]} is not as the API server writes it: save it with kubectl get -o json",
                code=Exit.SYNTAX,
            )
    return items


def _take_over(kubectl: Kubectl, found: Plan, arguments: argparse.Namespace) -> None:
    _refuse_losses(found, lossy=arguments.lossy)
    for made in found.apps:
        apps.apply(kubectl, made.app, dry_run=True)
    backup = opened(arguments.backup)
    for made in found.apps:
        for each in made.workloads:
            backup.add_json(backup_name(each.stored), restorable(each.stored))
    backup.close()
    limits, clock = Limits(ready_s=arguments.wait), Clock()
    titles: set[str] = set()
    try:
        for made in found.apps:
            old = [each.stored for each in made.workloads]
            take_over(kubectl, made.app, old, limits=limits, clock=clock, tell=tell, backup=backup.folder)
            names = [each.title for each in made.workloads]
            say(f"robotapp/{made.app['metadata']['name']}: Ready, in place of {', '.join(names)}")
            titles |= set(names)
    except BaseException:  # records of the apps before: a second run would not know their pods any more
        _try_to_clear_records(kubectl, found, titles)
        raise
    _clear_records(kubectl, found, titles)


def _refuse_losses(plan: Plan, *, lossy: bool) -> None:
    lost = sum(len(app.lost) for app in plan.apps)
    apart = sum(len(app.apart) for app in plan.apps)
    if lost and not lossy:
        raise BridgeError(
            Place("migrate"), f"{lost} fields would be lost, see the report; --lossy goes on without them"
        )
    if apart and not lossy:
        raise BridgeError(
            Place("migrate"),
            f"{'1 pair' if apart == 1 else f'{apart} pairs'} of workloads would no longer meet, see APART in the report; --lossy goes on all the same",
        )


def _try_to_clear_records(kubectl: Kubectl, found: Plan, titles: set[str]) -> None:
    try:
        _clear_records(kubectl, found, titles)
    except BridgeError as error:
        tell(f"records of {', '.join(sorted(titles))} are not cleared: {error}")


def _clear_records(kubectl: Kubectl, found: Plan, titles: set[str]) -> None:
    """Records of pods that are gone now: nobody else would remove them."""
    gone = [uid for uid, title in found.scene.owners.items() if title in titles]
    for node in sorted({node for node, _ in leftover_records(found.scene.claims, gone=gone)}):
        _clear_node(kubectl, node, gone)
    by_namespace: dict[str, list[str]] = {}
    for claim in found.scene.claims:
        if claim.kind == "fleet" and claim.uid in gone:
            by_namespace.setdefault(claim.where, []).append(claim.thing)
    for where, keys in by_namespace.items():
        forget(kubectl, where, keys)


def _clear_node(kubectl: Kubectl, node: str, gone: Sequence[str]) -> None:
    """The node is read again: other pods have come and gone since the migration began, and their entries are not ours to undo."""
    for left in reversed(range(_ATTEMPTS)):
        items = kubectl.items("get", "nodes", f"--field-selector=metadata.name={node}")
        stored = next((each for each in items if each["metadata"]["name"] == node), None)
        kept = leftover_records(scene([{"kind": "Node", **stored}]).claims, gone=gone) if stored else {}
        if not stored or not kept:
            return
        arguments = [annotation(kind, entries) for (_, kind), entries in kept.items()]
        try:
            annotate(kubectl, node, arguments, version=stored["metadata"]["resourceVersion"], tell=tell)
        except ClusterError as error:
            if error.reason is not Refusal.CONFLICT or not left:
                raise
        else:
            return


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BridgeError(Place(str(path)), f"cannot be written: {error.strerror}", code=Exit.UNREADABLE) from error


MIGRATE: Final = Verb(
    name="migrate",
    summary="turn annotated pods of the thesis' time into RobotApps",
    description=(
        "Write RobotApps for the Deployments and pods whose pods have annotations scheduler.robotics.io/…, and a report of what "
        "changes: fields, domains and devices in node annotations, the fleet map. Nothing is changed without --apply, which ends the "
        "old workloads, starts the apps, and takes an app back that does not become Ready."
    ),
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge migrate > apps.yaml", "what this namespace would become, and a report"),
        ("rigel-bridge migrate --apply --backup old/", "replace the workloads, one app after the other"),
        ("rigel-bridge migrate rigel-k8s-application --distro noetic", "one workload, without annotations"),
        ("rigel-bridge migrate -f cluster.json", "without a cluster"),
    ),
)
