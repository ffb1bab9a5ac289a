"""An operator that hangs between its read and its write, while its app is deleted and the domain goes to another app.

The zombie talks through a proxy; at the chosen write it is stopped with SIGSTOP and the write is held back. Meanwhile a
second operator gives the only domain of the pool to another app. Then the write arrives after all.
There is no garbage collector, which would tidy the stale objects up before they can do harm, and the scheduler never
hears of the deletion: only the claim as it is stored can keep the stale pods off.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from tests.support.proxy import FaultProxy, Moment, Write, hide

from campaigns.rigs.invariants import claims, domain_of, violations
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from robotapp_api.model.names import Label, PodReason
from robotapp_testbed import ControlPlane, Process, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.topology import fleet

pytestmark = pytest.mark.live

WATCHED_S = 4.0
"""How long the stale objects are watched after the zombie woke: several sweeps and rounds of the scheduler's back-off."""


class Hold:
    """Stops `zombie` at the first write that `matches` and keeps that write back until `release`."""

    def __init__(self, proxy: FaultProxy, zombie: Process, matches: Callable[[Write], bool]) -> None:
        self._zombie, self._matches = zombie, matches
        self._reached, self._released = threading.Event(), threading.Event()
        self._proxy = proxy
        proxy.on_write(self._strike)

    def _strike(self, write: Write, moment: Moment) -> None:
        if moment is Moment.BEFORE and not self._reached.is_set() and self._matches(write):
            self._zombie.pause()
            self._reached.set()
            self._released.wait(timeout=240)

    def until_reached(self) -> None:
        assert self._reached.wait(timeout=60), "the zombie never came to the write"

    def release(self) -> None:
        self._released.set()
        self._zombie.resume()


@pytest.fixture(scope="module")
def plane() -> Iterator[ControlPlane]:
    without_gc = {"kube-controller-manager": ["--controllers=*,-garbage-collector-controller"]}
    with ControlPlane(audit=True, extra_args=without_gc) as cp:
        product.install(cp)
        yield cp


@contextmanager
def haunted(plane: ControlPlane, domain: int) -> Iterator[tuple[SimulatedSite, FaultProxy]]:
    """A world whose operator talks through a proxy, without election, and a pool `one-N` of that one domain."""
    with FaultProxy() as proxy, FaultProxy() as deaf:  # two, since a held write stops everything in its proxy
        route, deaf_route = (
            proxy.route("zombie", plane.kubeconfig("operator")),
            deaf.route("scheduler", plane.kubeconfig("scheduler")),
        )
        deaf.add(hide(when=_deletion_of_first), verbs="watch", resource="robotapps", times=None)
        nodes = fleet(robots=1, edges=2, clouds=1)
        with SimulatedSite(
            plane,
            nodes,
            pools={f"one-{domain}": str(domain)},
            operator_flags={"kubeconfig": route.kubeconfig, "no_leader_election": True, "name": "zombie"},
            scheduler_flags={"kubeconfig": deaf_route.kubeconfig},
            tidy=False,
        ) as world:
            yield world, proxy
            assert proxy.errors == []


def test_a_late_template_of_a_deleted_app_makes_pods_that_never_bind(plane: ControlPlane) -> None:
    with haunted(plane, 1) as (world, proxy):
        hold = Hold(proxy, world.operator, lambda write: _is_template(write) and write.call.verb == "create")
        first = _create(world, "first", 1)
        hold.until_reached()
        assert _holders(plane, 1) == [first]
        second = _replaced(world, 1)
        hold.release()
        assert wait_until(lambda: _pods_of(world, first), timeout_s=60), "the late write made no pod"
        _never_bound(world, first)
        assert _holders(plane, 1) == [second]
        (stale,) = _pods_of(world, first)
        assert domain_of(stale) == "1"
        assert wait_until(lambda: _scheduled(world, first).get("reason") == PodReason.WAITING_FOR_DOMAIN, timeout_s=60)
        said = _scheduled(world, first)
        assert said["status"] == "False"
        assert "domain 1 is held by another app" in said["message"]
        world.delete("second")


def test_a_late_claim_of_a_deleted_app_finds_the_domain_taken(plane: ControlPlane) -> None:
    with haunted(plane, 2) as (world, proxy):
        hold = Hold(proxy, world.operator, lambda write: write.call.resource == "robotclaims")
        first = _create(world, "first", 2)
        hold.until_reached()
        second = _replaced(world, 2)
        hold.release()
        _never_bound(world, first)
        assert _holders(plane, 2) == [second]
        assert _pods_of(world, first) == []


def test_a_late_change_of_a_deleted_template_does_not_bring_it_back(plane: ControlPlane) -> None:
    with haunted(plane, 3) as (world, proxy):
        first = _create(world, "first", 3)
        world.watch.until_ready("first", within_s=60)
        hold = Hold(proxy, world.operator, lambda write: _is_template(write) and write.call.verb == "patch")
        change = [{"op": "replace", "path": "/spec/components/0/image", "value": "registry.example/part:2"}]
        world.cp.api.patch(f"{world.apps_path}/first", change, content_type="application/json-patch+json")
        hold.until_reached()
        second = _replaced(world, 3, tidy=f"{Label.APP_UID}={first}")
        hold.release()
        _never_bound(world, first)
        assert _holders(plane, 3) == [second]
        assert _pods_of(world, first) == []


def _create(world: SimulatedSite, name: str, domain: int) -> str:
    """Create an app of one component on the pool of this one domain; its uid."""
    world.create(plain_app(name, parts=("only",), ros2={"pool": f"one-{domain}", "discovery": {"mode": "Multicast"}}))
    return str(world.app(name)["metadata"]["uid"])


def _replaced(world: SimulatedSite, domain: int, *, tidy: str = "") -> str:
    """Delete the first app (and what `tidy` selects); a second operator gives its domain to a second app, whose uid this is."""
    world.delete("first")
    if tidy:
        world.kubectl("delete", "deployments,replicasets,pods", "--selector", tidy, "--wait=false")
    world.another_operator()
    second = _create(world, "second", domain)
    world.watch.until_ready("second", within_s=60)
    return second


def _never_bound(world: SimulatedSite, uid: str) -> None:
    """For a while no pod of `uid` gets a node and no two apps run on one domain; the second app stays Ready."""
    seen: list[str] = []

    def broken() -> bool:
        bound = [pod["metadata"]["name"] for pod in _pods_of(world, uid) if pod["spec"].get("nodeName")]
        seen.extend([*bound, *violations(world.cp, world.namespace)])
        return bool(seen)

    assert not wait_until(broken, timeout_s=WATCHED_S, poll_s=0.05), seen
    world.watch.until_ready("second", within_s=1)


def _deletion_of_first(line: bytes) -> bool:
    return b'"DELETED"' in line and b'"name":"first"' in line


def _is_template(write: Write) -> bool:
    return write.call.resource == "deployments" and b"ROS_DOMAIN_ID" in write.call.body


def _pods_of(world: SimulatedSite, uid: str) -> list[dict[str, Any]]:
    return [pod for pod in world.pods() if pod["metadata"]["labels"].get(Label.APP_UID) == uid]


def _scheduled(world: SimulatedSite, uid: str) -> dict[str, Any]:
    """What is said of the placement of the only pod of `uid`; nothing before the scheduler has looked at it."""
    (pod,) = _pods_of(world, uid)
    return next((each for each in pod["status"].get("conditions", ()) if each["type"] == "PodScheduled"), {})


def _holders(plane: ControlPlane, domain: int) -> list[str]:
    """Uids that hold the domain of this number."""
    held = [claim["spec"] for claim in claims(plane) if claim["spec"].get("domain", {}).get("id") == domain]
    return [spec["holder"]["uid"] for spec in held]
