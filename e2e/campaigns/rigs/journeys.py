"""What users do with many apps at once, and what must hold then. Small in tests/live/journeys, large in e2e/campaigns."""

import contextlib
import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from campaigns.rigs.appwatch import App, AppWatch, condition, is_available, is_ready
from campaigns.rigs.world import APIS, Object, World, plain_app
from robotapp_api.model.names import SCHEDULER_NAME, Condition, Label, Reason
from robotapp_client.api.resources import DEPLOYMENTS
from robotapp_testbed import wait_until
from robotapp_testbed.failures import ApiStatusError


@dataclass(frozen=True, slots=True)
class Storm:
    """`seconds` from the first create until the last app was Ready, `most_s` until 95 % were; `problems` in words.

    `deployments`: how many the operator made, discovery servers included.
    """

    seconds: float
    most_s: float
    domains: Mapping[str, int]
    problems: tuple[str, ...]
    deployments: int = 0


@dataclass(frozen=True, slots=True)
class Overflow:
    """More apps than ids: how many ran and waited, what the waiting were told, and how they came to run."""

    ready: int
    waiting: int
    messages: tuple[str, ...]
    seconds: float
    freed_s: float
    """From the deletion of as many others as wait until all of them are Ready."""
    problems: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Disturbed:
    """Seconds from the creation of a healthy app until it is Ready: alone, and right after each lot of bad ones."""

    alone_s: tuple[float, ...]
    between_s: tuple[float, ...]
    bad: int
    problems: tuple[str, ...]


def between_bad_ones(world: World, pool: str, lots: Sequence[Sequence[Object]], *, alone: int = 5) -> Disturbed:
    """Healthy apps one by one, then one right after each lot: apps that are refused or can never work, and bare pods."""
    alone_s = [start_one(world, f"alone-{number}", pool) for number in range(alone)]
    before = (world.operator.pid, world.scheduler.pid)
    pods = f"/api/v1/namespaces/{world.namespace}/pods"
    between_s = []
    for number, lot in enumerate(lots):
        world.cp.api.each(lambda obj: _give(world, pods, obj), lot)
        between_s.append(start_one(world, f"between-{number}", pool))
    world.cp.api.delete(f"{pods}?labelSelector=!{Label.APP}")
    restarted = (world.operator.pid, world.scheduler.pid) != before
    problems = ("operator or scheduler restarted",) if restarted else ()
    return Disturbed(tuple(alone_s), tuple(between_s), sum(len(lot) for lot in lots), problems)


def start_one(world: World, name: str, pool: str) -> float:
    """Seconds from the creation of a healthy app until it is Ready."""
    sent_s = world.create(plain_app(name, ros2={"pool": pool}))
    return world.watch.until_ready(name, within_s=60) - sent_s


def _give(world: World, pods: str, obj: Object) -> None:
    """Create an app or a bare pod; a refusal is an answer like another."""
    with contextlib.suppress(ApiStatusError):
        if obj.get("kind") == "RobotApp":
            world.create(obj)
        else:
            world.cp.api.create(pods, obj)


def storm(world: World, pools: Sequence[str], *, apps: int, within_s: float, rmw: str = "rmw_fastrtps_cpp") -> Storm:
    """Apply `apps` apps of three components at once, spread over `pools`; all get Ready, no id twice in a pool.

    With Fast DDS each app has two discovery servers besides, with Cyclone DDS its participants find each other by name.
    """
    made = [
        plain_app(f"storm-{number:03}", ros2={"pool": pools[number % len(pools)], "rmw": rmw}) for number in range(apps)
    ]
    sent_s = world.create_all(made)
    ready_s = world.watch.until_ready(*(app["metadata"]["name"] for app in made), within_s=within_s)
    ids = {pool: [claim["spec"]["domain"]["id"] for claim in world.claims(pool)] for pool in pools}
    problems = [
        f"pool {pool} gave {number} away {count} times" for pool in pools for number, count in _doubles(ids[pool])
    ]
    problems += _not_one_each(world, pools, apps)
    most_s = _quantile(
        [world.watch.ready_s[world.watch.apps[app["metadata"]["name"]]["metadata"]["uid"]] for app in made], 0.95
    )
    domains = {pool: len(found) for pool, found in ids.items()}
    made_of = len(world.cp.api.get(_deployments(world))["items"])
    return Storm(ready_s - sent_s, most_s - sent_s, domains, tuple(problems), made_of)


def bare(world: World, *, count: int, within_s: float) -> float:
    """Seconds from the first create until `count` Deployments of one container each, all applied at once, are available."""
    return by_hand(world, [_bare_deployment(f"bare-{number:04}") for number in range(count)], within_s=within_s)


def by_hand(world: World, made: Sequence[Object], *, within_s: float) -> float:
    """Seconds from the first create until these Deployments, all applied at once, are available.

    Our scheduler places their pods; no RobotApp is involved. They are deleted afterwards.
    """
    path = _deployments(world)
    with AppWatch(world.cp.kubeconfig(), world.namespace, resource=DEPLOYMENTS, ready=is_available) as watch:
        sent_s = time.monotonic()
        world.cp.api.each(lambda obj: world.cp.api.create(path, obj), made)
        ready_s = watch.until_ready(*(obj["metadata"]["name"] for obj in made), within_s=within_s)
    world.cp.api.delete(path)
    if not wait_until(lambda: not world.pods(), timeout_s=within_s, poll_s=0.5):
        raise AssertionError(f"{len(world.pods())} pods are left of the Deployments")
    return ready_s - sent_s


def as_if_by_hand(world: World) -> list[Object]:
    """The Deployments that the operator made of the apps, as a user would have written them: without owners, and with labels and
    annotations of another name and the same length, so that they are nobody's.
    """
    made = []
    for found in world.cp.api.get(_deployments(world))["items"]:
        named = json.loads(json.dumps(found).replace("robotics.io/", "handmade.io/"))
        meta = {key: named["metadata"][key] for key in ("name", "labels", "annotations")}
        made.append({"apiVersion": "apps/v1", "kind": "Deployment", "metadata": meta, "spec": named["spec"]})
    return made


def _deployments(world: World) -> str:
    return f"/apis/apps/v1/namespaces/{world.namespace}/deployments"


def _bare_deployment(name: str) -> Object:
    labels = {"app": name}
    pod = {"schedulerName": SCHEDULER_NAME, "containers": [{"name": "main", "image": "registry.example/part:1"}]}
    spec = {"selector": {"matchLabels": labels}, "template": {"metadata": {"labels": labels}, "spec": pod}}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": {"name": name}, "spec": spec}


def overflow(world: World, pool: str, *, size: int, apps: int, within_s: float) -> Overflow:
    """Apply more apps than the pool has ids, then delete as many running ones as wait."""
    names = [f"over-{number:03}" for number in range(apps)]
    sent_s = world.create_all([plain_app(name, parts=("only",), ros2={"pool": pool}) for name in names])
    full_s = world.watch.until(
        lambda seen: len(_ready(seen, names)) == size and len(_refused(seen, names)) == apps - size,
        within_s=within_s,
        what=f"{size} apps Ready and {apps - size} refused",
    )
    seen = world.watch.snapshot()
    running, waiting = _ready(seen, names), _refused(seen, names)
    messages = tuple(str(condition(seen[name], Condition.ALLOCATED).get("message", "")) for name in waiting)
    problems = [f"{len(world.claims(pool))} claims of a pool of {size}"] if len(world.claims(pool)) != size else []
    deleted_s = world.delete(*running[: len(waiting)])
    ready_s = world.watch.until_ready(*waiting, within_s=within_s)
    return Overflow(len(running), len(waiting), messages, full_s - sent_s, ready_s - deleted_s, tuple(problems))


def one_per_robot(world: World, *, pool: str, within_s: float) -> Storm:
    """One app with an instance on each of the world's robots: as many domains and RobotAppInstances as robots."""
    selector = {"matchExpressions": [{"key": Label.ROBOT, "operator": "In", "values": _robots(world)}]}
    app = plain_app("fleet", parts=("drive", "watch"), robots={"nodeSelector": selector}, ros2={"pool": pool})
    app["spec"]["components"][0]["runsOn"] = ["Robot"]
    sent_s = world.create(app)
    ready_s = world.watch.until_ready("fleet", within_s=within_s)
    claims = world.claims(pool)
    ids = [claim["spec"]["domain"]["id"] for claim in claims]
    instances = Counter(claim["spec"]["holder"].get("instance", "") for claim in claims)
    problems = [f"domain {number} {count} times" for number, count in _doubles(ids)]
    if sorted(instances) != sorted(_robots(world)) or max(instances.values()) > 1:
        problems.append(
            f"{len(instances)} instances of {len(_robots(world))} robots hold claims: {instances.most_common(3)}"
        )
    if not wait_until(lambda: _shown(world) == _robots(world), timeout_s=within_s, poll_s=0.2):
        problems.append(f"RobotAppInstances that are Ready: {_shown(world)}")
    return Storm(ready_s - sent_s, ready_s - sent_s, {pool: len(set(ids))}, tuple(problems))


def _shown(world: World) -> list[str]:
    """Robots whose RobotAppInstance is Ready and names the domain."""
    found = world.cp.api.get(f"{APIS}/namespaces/{world.namespace}/robotappinstances")["items"]
    ready = [each for each in found if condition(each, Condition.READY).get("status") == "True"]
    return sorted(each["spec"]["robot"] for each in ready if "domain" in each["status"])


def _quantile(values: Sequence[float], share: float) -> float:
    return sorted(values)[int(share * (len(values) - 1))]


def _robots(world: World) -> list[str]:
    return sorted(node.robot for node in world.nodes if node.robot)


def _ready(seen: Mapping[str, App], names: Sequence[str]) -> list[str]:
    return [name for name in names if name in seen and is_ready(seen[name])]


def _refused(seen: Mapping[str, App], names: Sequence[str]) -> list[str]:
    return [
        name
        for name in names
        if name in seen and condition(seen[name], Condition.ALLOCATED).get("reason") == Reason.DOMAIN_EXHAUSTED
    ]


def _doubles(ids: Sequence[int]) -> list[tuple[int, int]]:
    return [(number, count) for number, count in Counter(ids).items() if count > 1]


def _not_one_each(world: World, pools: Sequence[str], apps: int) -> list[str]:
    holders = Counter(claim["spec"]["holder"]["uid"] for pool in pools for claim in world.claims(pool))
    all_one = len(holders) == apps and set(holders.values()) == {1}
    return [] if all_one else [f"{len(holders)} of {apps} apps hold {holders.total()} domains"]
