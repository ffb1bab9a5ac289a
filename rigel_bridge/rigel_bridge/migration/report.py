"""What a migration changes, object by object, and what is left for an admin."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigel_bridge.document.failures import BridgeError
from rigel_bridge.migration.apps import Migrated, migrated
from rigel_bridge.migration.found import CLAIMS, FLEET, Claim, Scene
from rigel_bridge.migration.joining import join, keep_meeting, select
from rigel_bridge.migration.ros_graphs import is_ros
from rigel_bridge.names import SCHEDULER_PREFIX


@dataclass(frozen=True, slots=True)
class Plan:
    """All apps to be, and workloads that stay with the reason."""

    apps: tuple[Migrated, ...]
    refused: tuple[str, ...]
    scene: Scene


def plan(scene: Scene, *, distro: str = "", names: Sequence[str] = ()) -> Plan:
    """Migrate all workloads, or only those of these names. One that cannot be leaves the others alone."""
    chosen, staying = select(scene.workloads, names)
    refused: list[str] = []
    for workload in list(chosen):
        try:
            migrated((workload,), distro=distro)
        except BridgeError as error:
            refused.append(str(error))
            chosen.remove(workload)
            staying.append(workload)
    apps: dict[tuple[str, str], Migrated] = {}
    for group in join(chosen, distro=distro):
        app = migrated(group, distro=distro)
        if apps.setdefault((app.namespace, app.name), app) is not app:
            refused.append(f"{group[0].title}: becomes RobotApp {app.name}, which another one already is: rename one")
            staying += group
    strangers = [workload for workload in scene.staying if is_ros(workload)]
    kept = keep_meeting(list(apps.values()), (*staying, *strangers), distro=distro)
    return Plan(tuple(kept), tuple(refused), scene)


def lines(plan: Plan) -> Iterator[str]:
    """The report to read."""
    for made in plan.apps:
        spec, metadata = made.app["spec"], made.app["metadata"]
        yield f"RobotApp {metadata['namespace']}/{metadata['name']} from {', '.join(each.title for each in made.workloads)}"
        yield f"  {_components(spec)}, ROS {spec['ros']['distro']}, scheduler {spec.get('schedulerName', 'of the operator')}"
        yield from (f"  {note}" for note in made.notes)
        yield from (f"  LOST: {each} has no place in a RobotApp" for each in made.lost)
        yield from (f"  APART: {each}" for each in made.apart)
    yield from (f"stays: {each}" for each in plan.refused)
    yield from plan.scene.notes
    yield from (_claim_line(claim, plan) for claim in plan.scene.claims)


def _components(spec: Mapping[str, Any]) -> str:
    count = len(spec["components"])
    return f"{count} component" if count == 1 else f"{count} components"


def _claim_line(claim: Claim, plan: Plan) -> str:
    holder = plan.scene.owners.get(claim.uid)
    who = f"pod {claim.uid} of {holder}" if holder else f"pod {claim.uid}, which none of these workloads has"
    if claim.kind == "fleet":
        return f"configmap {claim.where}/{FLEET}: entry of {who}: the operator keeps a line per app instance instead"
    if claim.kind == "dds-claims":
        what = f"domain {claim.thing}"
        new = "the app gets its domain as a RobotClaim, for the whole cluster and all its pods"
    else:
        what, new = f"device {claim.thing}", "the scheduler claims the device as a RobotClaim"
    return f"node {claim.where}: {what} held by {who}: {new}"


def leftover_records(claims: Sequence[Claim], *, gone: Collection[str]) -> dict[tuple[str, str], dict[str, str]]:
    """What node annotations keep, by (node, kind), when the pods of these uids are gone; only records that name one of them.
    Entries of other pods stay, also of pods that were not seen: they may be of a namespace that was not read.
    """
    named = {(claim.where, claim.kind) for claim in claims if claim.kind in CLAIMS and claim.uid in gone}
    found: dict[tuple[str, str], dict[str, str]] = {key: {} for key in sorted(named)}
    for claim in claims:
        if (claim.where, claim.kind) in named and claim.uid not in gone:
            found[claim.where, claim.kind][claim.thing] = claim.uid
    return found


def annotation(kind: str, kept: Mapping[str, str]) -> str:
    """The argument of `kubectl annotate` for what a record keeps."""
    return f"{SCHEDULER_PREFIX}{kind}={json.dumps(dict(kept))}" if kept else f"{SCHEDULER_PREFIX}{kind}-"


def document(plan: Plan) -> dict[str, Any]:
    """The report as data."""
    return {
        "apps": [
            {
                "name": made.app["metadata"]["name"],
                "namespace": made.app["metadata"]["namespace"],
                "from": [each.title for each in made.workloads],
                "notes": list(made.notes),
                "lost": list(made.lost),
                "apart": list(made.apart),
            }
            for made in plan.apps
        ],
        "refused": list(plan.refused),
        "notes": list(plan.scene.notes),
        "records": [_claim_line(claim, plan) for claim in plan.scene.claims],
    }
