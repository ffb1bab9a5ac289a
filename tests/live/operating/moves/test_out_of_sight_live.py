"""A robot that vanishes for a second loses nothing, and the domain of one that is gone goes to nobody."""

import logging
import re
import secrets
import time
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import pytest

from campaigns.operating.out_of_sight import EVERY_ROBOT, Fleet
from campaigns.rigs.live import Tenant, eventually, part
from robotapp_api.model.names import Annotation, Label
from robotapp_client.api.times import utc_now
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology
from robotapp_testbed.processes.process import Process

log = logging.getLogger(__name__)
GRACE_S = 1
FLAPPING_S = 4.0
"""The full minute is `scripts/bench sight`."""
CLAIM = "/apis/robotics.io/v1alpha1/robotclaims/{}"


class Programs:
    """An operator and a scheduler with their own nodes."""

    def __init__(self, cp: ControlPlane) -> None:
        self.cp = cp
        self.scheduler = product.start_scheduler(cp, sweep_seconds=1)
        self.operator = self._operator()

    def _operator(self) -> Process:
        name = f"operator-{secrets.token_hex(2)}"
        return product.start_operator(self.cp, name=name, sweep_seconds=1, no_leader_election=True)

    def restart_operator(self) -> None:
        self.operator.stop()
        self.operator = self._operator()

    def stop(self) -> None:
        self.operator.stop()
        self.scheduler.stop()


@pytest.fixture(scope="module")
def robots(installed_plane: ControlPlane) -> Iterator[topology.Topology]:
    nodes = topology.fleet([f"amr-{number:02}" for number in range(20)], 0, 0)
    topology.apply(installed_plane, nodes)
    yield nodes
    topology.remove(installed_plane, nodes)


@pytest.fixture(scope="module")
def programs(installed_plane: ControlPlane, robots: topology.Topology) -> Iterator[Programs]:
    assert len(robots) == 20
    running = Programs(installed_plane)
    yield running
    running.stop()


@pytest.fixture
def fleet(
    installed_plane: ControlPlane, robots: topology.Topology, namespace: str, programs: Programs
) -> Iterator[Fleet]:
    assert programs.operator
    seed = secrets.randbelow(2**32)
    log.warning("seed %d", seed)
    found = Fleet(installed_plane, robots, Tenant(installed_plane, namespace), seed=seed)
    yield found
    found.bring(found.nodes)


def start(fleet: Fleet, ids: str, *, grace_s: int = 300, **robots: Any) -> None:
    """One driver on each robot, and the app is Ready."""
    chosen = {**EVERY_ROBOT, **robots}
    grace = {"grace": f"{grace_s}s"}
    driver = part("driver", runsOn=["Robot"])
    fleet.tenant.apply("fleet", driver, robots=chosen, connectivity=grace, ros2={"pool": ids})
    fleet.tenant.wait_ready("fleet")


def test_flapping_labels_and_a_node_that_joins_again_restart_no_pod_and_change_no_id(fleet: Fleet, ids: str) -> None:
    start(fleet, ids)
    before = fleet.seen()
    assert len(before.deployments) == len(before.pods) == len(before.domains) == 20
    named = [claim["status"]["nodes"] for claim in fleet.tenant.claims()]
    assert sorted(named) == [[robot] for robot in sorted(fleet.robots)]
    fleet.flap(FLAPPING_S)
    fleet.rejoin(fleet.chance.sample(fleet.robots, 3), after_s=1)
    fleet.online("fleet")
    assert before.lost(fleet.seen()) == []


def test_mass_removal_of_labels_ends_nothing_after_the_grace_nor_after_a_restart_of_the_operator(
    fleet: Fleet, ids: str, programs: Programs
) -> None:
    start(fleet, ids, grace_s=GRACE_S)
    before = fleet.seen()
    fleet.labels(fleet.robots, on=False)
    offline = {"desired": 20, "offline": 20}

    def counts() -> dict[str, int]:
        found = fleet.tenant.app("fleet")["status"]["instanceCounts"]
        return {key: found.get(key, 0) for key in offline}

    eventually(lambda: counts() == offline, what=counts)
    time.sleep(GRACE_S + 1)
    assert before.lost(fleet.seen()) == []
    programs.restart_operator()
    time.sleep(GRACE_S + 2)
    assert before.lost(fleet.seen()) == []
    fleet.labels(fleet.robots, on=True)
    fleet.online("fleet")
    assert before.lost(fleet.seen()) == []


def test_a_robot_that_stays_away_ends_after_the_grace_and_nobody_else_gets_its_domain(fleet: Fleet, ids: str) -> None:
    some = fleet.chance.sample(fleet.robots, 4)
    start(fleet, ids, grace_s=GRACE_S, nodeSelector=named(some))
    before, tenant = fleet.seen(), fleet.tenant
    gone = some[0]
    (claim,) = [name for name, instance in before.domains.items() if instance == gone]
    fleet.delete([gone])

    def running() -> set[str]:
        return {item["metadata"]["labels"]["robotics.io/instance"] for item in tenant.deployments()}

    eventually(lambda: running() == {*some} - {gone}, what=running)
    for pod in tenant.listed("pods"):  # as the garbage collector of the control plane does for a node that is gone
        if pod["spec"].get("nodeName") == gone:
            tenant.cp.api.delete(
                f"/api/v1/namespaces/{tenant.namespace}/pods/{pod['metadata']['name']}?gracePeriodSeconds=0"
            )
    assert phase(fleet, claim, wanted="Parked")["status"]["nodes"] == [gone]
    tenant.apply("thief", part("driver"), ros2={"pool": ids, "domain": int(claim.rpartition(".")[2])})
    tenant.wait("thief", "Allocated", "False", reason="DomainTaken")
    tenant.delete("thief")
    time.sleep(3)  # sweep and quarantine are one second each
    phase(fleet, claim, wanted="Parked")
    fleet.bring([gone])
    fleet.online("fleet", robots=len(some))
    lost = before.lost(fleet.seen())
    assert all(item.startswith(("Deployment", "pod")) for item in lost), "it has its own domain again"
    assert len(lost) == 2, lost


def test_the_domain_of_a_deleted_app_is_parked_until_its_robot_is_back_or_an_admin_speaks(
    fleet: Fleet, ids: str
) -> None:
    two = fleet.chance.sample(fleet.robots, 2)
    start(fleet, ids, nodeSelector=named(two))
    claims = {instance: name for name, instance in fleet.seen().domains.items()}
    fleet.delete(two)
    fleet.tenant.delete("fleet")
    fleet.cp.api.delete(f"/api/v1/namespaces/{fleet.tenant.namespace}/pods?gracePeriodSeconds=0")
    for name in claims.values():
        phase(fleet, name, wanted="Parked")
    back, scrapped = two
    fleet.bring([back])
    eventually(lambda: claims[back] not in fleet.seen().domains, what=fleet.tenant.claims)
    found = phase(fleet, claims[scrapped], wanted="Parked")
    said = {str(Annotation.PODS_GONE): str(found["status"]["attempt"])}
    fleet.cp.api.patch(CLAIM.format(claims[scrapped]), {"metadata": {"annotations": said}})
    eventually(lambda: not fleet.tenant.claims(), what=fleet.tenant.claims)


def test_a_robot_whose_node_is_not_ready_is_offline_when_its_grace_is_over_and_not_before(
    fleet: Fleet, ids: str, programs: Programs
) -> None:
    (robot,) = fleet.chance.sample(fleet.robots, 1)
    tenant = fleet.tenant
    start(fleet, ids, grace_s=3600, nodeSelector=named([robot]))
    fleet.ready(robot, "Unknown")
    told = tenant.wait("fleet", "Ready", "False", reason="RobotNotReady")["message"]
    assert "(connectivity.grace, 3600 s)" in told
    status = tenant.app("fleet")["status"]
    assert (status["phase"], status["instanceCounts"].get("offline", 0)) == ("Degraded", 0)
    assert status["troubled"][0]["reason"] == "RobotNotReady"

    def shown() -> Any:
        (instance,) = tenant.instances("fleet")
        status = instance["status"]
        return status.get("phase"), [each.get("message") for each in status.get("components", ())]

    eventually(lambda: shown() == ("Degraded", [f"node {robot} is not Ready"]), what=shown)
    eventually(lambda: "RobotNotReady" in tenant.event_reasons("fleet"), what=lambda: tenant.event_reasons("fleet"))
    programs.restart_operator()
    tenant.edit("fleet", connectivity={"grace": "3000s"})
    later = tenant.wait("fleet", "Ready", "False", reason="RobotNotReady")["message"]
    assert "(connectivity.grace, 3000 s)" in later
    assert "RobotOffline" not in tenant.event_reasons("fleet")
    age_s = (utc_now() - datetime.fromisoformat(since(told))).total_seconds()
    tenant.edit("fleet", connectivity={"grace": f"{int(age_s) + 4}s"})
    tenant.wait("fleet", "Ready", "False", reason="RobotOffline")
    assert (utc_now() - datetime.fromisoformat(since(told))).total_seconds() >= int(age_s) + 3
    status = tenant.app("fleet")["status"]
    assert (status["phase"], status["instanceCounts"]["offline"]) == ("Offline", 1)
    eventually(lambda: "RobotOffline" in tenant.event_reasons("fleet"), what=lambda: tenant.event_reasons("fleet"))
    fleet.ready(robot, "True")


def since(message: str) -> str:
    """The moment in the message of a robot that is not Ready."""
    (found,) = re.findall(r"since (\S+Z):", message)
    return str(found)


def named(robots: list[str]) -> dict[str, Any]:
    """A selector of these robots."""
    return {"matchExpressions": [{"key": Label.ROBOT.value, "operator": "In", "values": robots}]}


def phase(fleet: Fleet, claim: str, *, wanted: str) -> dict[str, Any]:
    """The claim once it has this phase."""

    def look() -> dict[str, Any] | None:
        found: dict[str, Any] = fleet.cp.api.get(CLAIM.format(claim))
        return found if found["status"]["phase"] == wanted else None

    return eventually(look, what=fleet.tenant.claims) or {}
