"""Finds what needs somebody to look at it, each with the command that helps."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

from robotapp_api.model.names import Label, Reason
from robotapp_claims.rules.instances import primary_node
from robotapp_console.views.objects import App, Node, Pool
from robotapp_console.views.snapshot import Snapshot
from robotapp_console.views.texts import clean, kubectl, with_namespace

NEARLY_FULL: Final = 0.9
MOST_SHOWN: Final = 50
_DEVICES: Final = frozenset({Reason.DEVICE_BUSY, Reason.DEVICE_LOST, Reason.WAITING_FOR_DEVICES})
_DOMAINS: Final = frozenset(
    {
        Reason.DOMAIN_EXHAUSTED,
        Reason.DOMAIN_TAKEN,
        Reason.QUOTA_EXCEEDED,
        Reason.POOL_NOT_FOUND,
        Reason.POOL_OVERLAPS,
        Reason.CLAIM_CONFLICT,
    }
)
_PLACEMENT: Final = frozenset(
    {Reason.UNSCHEDULABLE, Reason.WAITING_FOR_PODS, Reason.BUDGET_EXCEEDED, Reason.FALLBACK_USED, Reason.NOT_MEASURED}
)
_ROBOTS: Final = frozenset(
    {Reason.ROBOT_OFFLINE, Reason.ROBOT_NOT_READY, Reason.ROBOT_NODE_UNCLEAR, Reason.NO_MATCHING_ROBOT}
)
_PODS: Final = frozenset({Reason.IMAGE_PULL, Reason.FAILED_CREATE, Reason.QUOTA_REFUSED})


@dataclass(frozen=True, slots=True)
class Problem:
    """One line of the list. `subject` names the object, `href` leads to its page where it has one."""

    subject: str
    reason: str
    message: str
    command: str
    href: str = ""


@dataclass(frozen=True, slots=True)
class Problems:
    """The problems of which a page has room; `total` counts all."""

    listed: tuple[Problem, ...]
    total: int


def find_problems(snapshot: Snapshot) -> Problems:
    """Returns full pools first, because they stop every new app, then troubled apps, then robots without a clear node."""
    problems = [
        *_list_full_pools(snapshot.pools.values()),
        *(problem for _, app in sorted(snapshot.apps.items()) for problem in list_troubled(app)),
        *_list_unclear_robots(snapshot.nodes),
    ]
    return Problems(tuple(problems[:MOST_SHOWN]), len(problems))


def list_troubled(app: App) -> list[Problem]:
    """Returns the instances of an app that need somebody, in the operator's order: worst first."""
    meta = app.metadata
    name = f"{meta.namespace}/{meta.name}"
    return [
        Problem(
            clean(f"{name} on {item.instance}" if item.instance else name, 320),
            clean(item.reason, 64),
            clean(item.message),
            suggest_command(item.reason, namespace=meta.namespace, app=meta.name, robot=item.instance),
            path_of_app(meta.namespace, meta.name, item.instance),
        )
        for item in app.status.troubled
    ]


def path_of_app(namespace: str, name: str, robot: str = "") -> str:
    """Returns the address of the app's page, or of one of its instances on it."""
    path = f"/apps/{quote(namespace, safe='')}/{quote(name, safe='')}"
    return f"{path}?robot={quote(robot, safe='')}" if robot else path


def suggest_command(reason: str, *, namespace: str, app: str, robot: str = "") -> str:
    """Returns the command that shows more about a condition's reason."""
    in_namespace = with_namespace(namespace)
    on_robot = ("--robot", robot) if robot else ()
    if reason in _DEVICES:
        return kubectl("robotapp", "devices")
    if reason in _DOMAINS:
        return kubectl("robotapp", "domains")
    if reason in _PLACEMENT:
        return kubectl("robotapp", "explain", app, *in_namespace, *on_robot)
    if reason in _ROBOTS:
        return kubectl("robotapp", "robots")
    if reason in _PODS:
        return kubectl("describe", "pods", *in_namespace, "-l", f"{Label.APP}={app}")
    if reason == Reason.CRASH_LOOP:
        return kubectl("logs", *in_namespace, "-l", f"{Label.APP}={app}", "--all-containers", "--prefix", "--tail=50")
    return kubectl("robotapp", "info", app, *in_namespace, *on_robot)


def _list_full_pools(pools: Iterable[Pool]) -> list[Problem]:
    problems = []
    for pool in sorted(pools, key=lambda pool: pool.metadata.name):
        used, _, capacity = pool.status.used.partition("/")
        if not (used.isdigit() and capacity.isdigit() and int(capacity)):
            continue
        if int(used) >= NEARLY_FULL * int(capacity):
            full = int(used) >= int(capacity)
            message = f"{used} of {capacity} domain ids are claimed" + (": no new app gets one" if full else "")
            resting = f", {pool.status.quarantined} of them rest and are free soon" if pool.status.quarantined else ""
            problems.append(
                Problem(
                    f"pool {clean(pool.metadata.name, 63)}",
                    "PoolFull" if full else "PoolNearlyFull",
                    message + resting,
                    kubectl("robotapp", "domains"),
                )
            )
    return problems


def _list_unclear_robots(nodes: Mapping[str, Node]) -> list[Problem]:
    computers: dict[str, list[Node]] = defaultdict(list)
    for node in nodes.values():
        if robot := node.labels.get(Label.ROBOT):
            computers[robot].append(node)
    problems = []
    for robot, members in sorted(computers.items()):
        if len(members) > 1 and (problem := primary_node(robot, members).problem):
            command = kubectl("label", "node", "NODE", f"{Label.ROBOT_PRIMARY}=true")
            problems.append(Problem(f"robot {clean(robot, 63)}", Reason.ROBOT_NODE_UNCLEAR, clean(problem), command))
    return problems
