"""What users do with many apps at once, and what must hold then. Small in tests/live/journeys, large in e2e/campaigns."""

import contextlib
import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from campaigns.rigs.appwatch import App, AppWatch, condition, is_available, is_ready
from campaigns.rigs.simulated_site import APIS, Object, SimulatedSite, plain_app
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


def between_bad_ones(site: SimulatedSite, pool: str, lots: Sequence[Sequence[Object]], *, alone: int = 5) -> Disturbed:
    """Healthy apps one by one, then one right after each lot: apps that are refused or can never work, and bare pods."""
    alone_s = [start_one(site, f"alone-{number}", pool) for number in range(alone)]
    before = (site.operator.pid, site.scheduler.pid)
    pods = f"/api/v1/namespaces/{site.namespace}/pods"
    between_s = []
    for number, lot in enumerate(lots):
        site.cp.api.each(lambda obj: _give(site, pods, obj), lot)
        between_s.append(start_one(site, f"between-{number}", pool))
    site.cp.api.delete(f"{pods}?labelSelector=!{Label.APP}")
    restarted = (site.operator.pid, site.scheduler.pid) != before
    problems = ("operator or scheduler restarted",) if restarted else ()
    return Disturbed(tuple(alone_s), tuple(between_s), sum(len(lot) for lot in lots), problems)


def start_one(site: SimulatedSite, name: str, pool: str) -> float:
    """Seconds from the creation of a healthy app until it is Ready."""
    sent_s = site.create(plain_app(name, ros2={"pool": pool}))
    return site.watch.until_ready(name, within_s=60) - sent_s


def _give(site: SimulatedSite, pods: str, obj: Object) -> None:
    """Create an app or a bare pod; a refusal is an answer like another."""
    with contextlib.suppress(ApiStatusError):
        if obj.get("kind") == "RobotApp":
            site.create(obj)
        else:
            site.cp.api.create(pods, obj)


def storm(
    site: SimulatedSite, pools: Sequence[str], *, apps: int, within_s: float, rmw: str = "rmw_fastrtps_cpp"
) -> Storm:
    """Apply `apps` apps of three components at once, spread over `pools`; all get Ready, no id twice in a pool.

    With Fast DDS each app has two discovery servers besides, with Cyclone DDS its participants find each other by name.
    """
    made = [
        plain_app(f"storm-{number:03}", ros2={"pool": pools[number % len(pools)], "rmw": rmw}) for number in range(apps)
    ]
    sent_s = site.create_all(made)
    ready_s = site.watch.until_ready(*(app["metadata"]["name"] for app in made), within_s=within_s)
    ids = {pool: [claim["spec"]["domain"]["id"] for claim in site.claims(pool)] for pool in pools}
    problems = [
        f"pool {pool} gave {number} away {count} times" for pool in pools for number, count in _doubles(ids[pool])
    ]
    problems += _not_one_each(site, pools, apps)
    most_s = _quantile(
        [site.watch.ready_s[site.watch.apps[app["metadata"]["name"]]["metadata"]["uid"]] for app in made], 0.95
    )
    domains = {pool: len(found) for pool, found in ids.items()}
    made_of = len(site.cp.api.get(_deployments(site))["items"])
    return Storm(ready_s - sent_s, most_s - sent_s, domains, tuple(problems), made_of)


def bare(site: SimulatedSite, *, count: int, within_s: float) -> float:
    """Seconds from the first create until `count` Deployments of one container each, all applied at once, are available."""
    return by_hand(site, [_bare_deployment(f"bare-{number:04}") for number in range(count)], within_s=within_s)


def by_hand(site: SimulatedSite, made: Sequence[Object], *, within_s: float) -> float:
    """Seconds from the first create until these Deployments, all applied at once, are available.

    Our scheduler places their pods; no RobotApp is involved. They are deleted afterwards.
    """
    path = _deployments(site)
    with AppWatch(site.cp.kubeconfig(), site.namespace, resource=DEPLOYMENTS, ready=is_available) as watch:
        sent_s = time.monotonic()
        site.cp.api.each(lambda obj: site.cp.api.create(path, obj), made)
        ready_s = watch.until_ready(*(obj["metadata"]["name"] for obj in made), within_s=within_s)
    site.cp.api.delete(path)
    if not wait_until(lambda: not site.pods(), timeout_s=within_s, poll_s=0.5):
        raise AssertionError(f"{len(site.pods())} pods are left of the Deployments")
    return ready_s - sent_s


def as_if_by_hand(site: SimulatedSite) -> list[Object]:
    """The Deployments that the operator made of the apps, as a user would have written them: without owners, and with labels and
    annotations of another name and the same length, so that they are nobody's.
    """
    made = []
    for found in site.cp.api.get(_deployments(site))["items"]:
        named = json.loads(json.dumps(found).replace("robotics.io/", "handmade.io/"))
        meta = {key: named["metadata"][key] for key in ("name", "labels", "annotations")}
        made.append({"apiVersion": "apps/v1", "kind": "Deployment", "metadata": meta, "spec": named["spec"]})
    return made


def _deployments(site: SimulatedSite) -> str:
    return f"/apis/apps/v1/namespaces/{site.namespace}/deployments"


def _bare_deployment(name: str) -> Object:
    labels = {"app": name}
    pod = {"schedulerName": SCHEDULER_NAME, "containers": [{"name": "main", "image": "registry.example/part:1"}]}
    spec = {"selector": {"matchLabels": labels}, "template": {"metadata": {"labels": labels}, "spec": pod}}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": {"name": name}, "spec": spec}


def overflow(site: SimulatedSite, pool: str, *, size: int, apps: int, within_s: float) -> Overflow:
    """Apply more apps than the pool has ids, then delete as many running ones as wait."""
    names = [f"over-{number:03}" for number in range(apps)]
    sent_s = site.create_all([plain_app(name, parts=("only",), ros2={"pool": pool}) for name in names])
    full_s = site.watch.until(
        lambda seen: len(_ready(seen, names)) == size and len(_refused(seen, names)) == apps - size,
        within_s=within_s,
        what=f"{size} apps Ready and {apps - size} refused",
    )
    seen = site.watch.snapshot()
    running, waiting = _ready(seen, names), _refused(seen, names)
    messages = tuple(str(condition(seen[name], Condition.ALLOCATED).get("message", "")) for name in waiting)
    problems = [f"{len(site.claims(pool))} claims of a pool of {size}"] if len(site.claims(pool)) != size else []
    deleted_s = site.delete(*running[: len(waiting)])
    ready_s = site.watch.until_ready(*waiting, within_s=within_s)
    return Overflow(len(running), len(waiting), messages, full_s - sent_s, ready_s - deleted_s, tuple(problems))


def one_per_robot(site: SimulatedSite, *, pool: str, within_s: float) -> Storm:
    """One app with an instance on each of the site's robots: as many domains and RobotAppInstances as robots."""
    selector = {"matchExpressions": [{"key": Label.ROBOT, "operator": "In", "values": _robots(site)}]}
    app = plain_app("fleet", parts=("drive", "watch"), robots={"nodeSelector": selector}, ros2={"pool": pool})
    app["spec"]["components"][0]["runsOn"] = ["Robot"]
    sent_s = site.create(app)
    ready_s = site.watch.until_ready("fleet", within_s=within_s)
    claims = site.claims(pool)
    ids = [claim["spec"]["domain"]["id"] for claim in claims]
    instances = Counter(claim["spec"]["holder"].get("instance", "") for claim in claims)
    problems = [f"domain {number} {count} times" for number, count in _doubles(ids)]
    if sorted(instances) != sorted(_robots(site)) or max(instances.values()) > 1:
        problems.append(
            f"{len(instances)} instances of {len(_robots(site))} robots hold claims: {instances.most_common(3)}"
        )
    if not wait_until(lambda: _shown(site) == _robots(site), timeout_s=within_s, poll_s=0.2):
        problems.append(f"RobotAppInstances that are Ready: {_shown(site)}")
    return Storm(ready_s - sent_s, ready_s - sent_s, {pool: len(set(ids))}, tuple(problems))


def _shown(site: SimulatedSite) -> list[str]:
    """Robots whose RobotAppInstance is Ready and names the domain."""
    found = site.cp.api.get(f"{APIS}/namespaces/{site.namespace}/robotappinstances")["items"]
    ready = [each for each in found if condition(each, Condition.READY).get("status") == "True"]
    return sorted(each["spec"]["robot"] for each in ready if "domain" in each["status"])


def _quantile(values: Sequence[float], share: float) -> float:
    return sorted(values)[int(share * (len(values) - 1))]


def _robots(site: SimulatedSite) -> list[str]:
    return sorted(node.robot for node in site.nodes if node.robot)


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


def _not_one_each(site: SimulatedSite, pools: Sequence[str], apps: int) -> list[str]:
    holders = Counter(claim["spec"]["holder"]["uid"] for pool in pools for claim in site.claims(pool))
    all_one = len(holders) == apps and set(holders.values()) == {1}
    return [] if all_one else [f"{len(holders)} of {apps} apps hold {holders.total()} domains"]
