"""A real loop: real DDS and real ROS 1 between containers on real nodes, on what our operator granted and generated."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.work_unit import slowness

from campaigns.nodes import teleop_app as teleop
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import cloud, edge, robot
from robotapp_testbed.real import RealNodes
from ros_nodes.trips import FOREIGN, summarise

pytestmark = pytest.mark.live

FIRST_TRIP_S = 6.0
"""Where `slowness` is 1."""
TRIES = 3
STABLE_S = 60.0
GIVEN_UP_S = 33.0
"""After 30 s Cyclone DDS 11 no longer asks a peer that never answered, unless it is told otherwise."""
DEADLINE_US = 100_000
"""Where `slowness` is 1."""


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    """Four nodes, operator and scheduler. Nobody measures latency here: unknown latency is allowed by default."""
    nodes = [robot("robot-1"), robot("robot-2"), edge("edge-1"), cloud("cloud-1")]
    delays = {
        ("robot-1", "edge-1"): 2,
        ("robot-2", "edge-1"): 2,
        ("robot-1", "cloud-1"): 15,
        ("robot-2", "cloud-1"): 15,
    }
    with real_machine(nodes, delays=delays, images=("tools", *teleop.IMAGES), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp)
        product.start_scheduler(cp)
        yield cp


@pytest.fixture
def place(cluster: RealNodes) -> Iterator[str]:
    with created(cluster, f"loop-{time.monotonic_ns() % 100_000}") as name:
        yield name


@pytest.mark.parametrize("ros", [2, 1])
def test_an_applied_app_measures_its_first_round_trip_within_seconds(cluster: RealNodes, place: str, ros: int) -> None:
    """Other programs of this machine can only delay it, so the quickest of three apps counts."""
    nodes = {"operator": "edge-1", "robot": "robot-1"}
    apps = [teleop.app(f"pair-{number}", ros=ros, nodes=nodes) for number in range(TRIES)]
    assert any(FIRST_TRIP_S * slowness() >= teleop.first_trip_s(cluster, place, app) for app in apps)
    measured = next(name for name in ("pair-2", "pair-1", "pair-0") if teleop.pods(cluster, place, name))
    assert wait_until(lambda: len(teleop.trips(cluster, place, measured)) > 100, timeout_s=60, poll_s=0.5)
    summary = summarise(teleop.rows(cluster, place, measured), deadline_us=DEADLINE_US, settle_us=1_000_000)
    assert summary.p50_us is not None
    assert 4000 <= summary.p50_us < 30_000 * slowness()  # the switch's 2 ms each way, and what a busy machine adds


def test_round_trips_follow_the_link(cluster: RealNodes, place: str) -> None:
    wanted = teleop.app("pair", nodes={"operator": "cloud-1", "robot": "robot-1"})
    teleop.first_trip_s(cluster, place, wanted)
    cluster.switch.set_link("robot-1", "cloud-1", delay_ms=40)
    try:
        assert wait_until(lambda: _recent_ms(cluster, place) >= 80, timeout_s=60, poll_s=0.5)
    finally:
        cluster.switch.set_link("robot-1", "cloud-1", delay_ms=15)
    assert wait_until(lambda: 30 <= _recent_ms(cluster, place) < 80, timeout_s=60, poll_s=0.5)


def _recent_ms(cp: RealNodes, place: str) -> float:
    recent = sorted(row.rtt_us or 0 for row in teleop.trips(cp, place, "pair")[-20:])
    return recent[len(recent) // 2] / 1000


def test_a_long_cut_ends_neither_the_app_that_ran_before_nor_the_one_that_starts_in_it(
    cluster: RealNodes, place: str
) -> None:
    """DDS gives a participant up after 10 s of silence."""
    nodes = {"operator": "edge-1", "robot": "robot-1"}
    teleop.first_trip_s(cluster, place, teleop.app("before", nodes=nodes))
    cluster.switch.set_link("robot-1", "edge-1", down=True)
    try:
        teleop.apply(cluster, place, [teleop.app("within", nodes=nodes)])
        assert wait_until(lambda: len(_restarts(cluster, place, "within")) == 2, timeout_s=90, poll_s=0.5)
        time.sleep(GIVEN_UP_S)
        assert teleop.trips(cluster, place, "within") == []
        count = len(teleop.trips(cluster, place, "before"))
    finally:
        cluster.switch.set_link("robot-1", "edge-1", down=False)
    for name, answered in (("within", 0), ("before", count)):
        assert _goes_on(cluster, place, name, after=answered)
        assert _restarts(cluster, place, name) == [0, 0]


def _goes_on(cp: RealNodes, place: str, app: str, *, after: int) -> bool:
    return wait_until(lambda: len(teleop.trips(cp, place, app)) > after + 50, timeout_s=90, poll_s=0.5)


def _restarts(cp: RealNodes, place: str, app: str) -> list[int]:
    """Of each container that runs; there is none before its pod's init steps are over."""
    return [
        status["restartCount"]
        for pod in teleop.pods(cp, place, app).values()
        for status in pod["status"].get("containerStatuses", ())
        if "running" in status["state"]
    ]


def test_two_apps_that_shout_by_multicast_never_hear_each_other(cluster: RealNodes, place: str) -> None:
    nodes = {"operator": "edge-1", "robot": "robot-1"}
    apps = [teleop.app(name, nodes=nodes, ros2={"discovery": {"mode": "Multicast"}}) for name in ("one", "two")]
    teleop.apply(cluster, place, apps)
    for name in ("one", "two"):
        assert wait_until(lambda name=name: len(teleop.trips(cluster, place, name)) > 200, timeout_s=90, poll_s=0.5)  # type: ignore[misc] # mypy sees no type for a default
        assert not [row for row in teleop.rows(cluster, place, name) if row.kind == FOREIGN]
    assert teleop.domain(cluster, place, "one") != teleop.domain(cluster, place, "two")


def test_three_apps_with_cameras_on_four_nodes_are_stable(cluster: RealNodes, place: str) -> None:
    """Other programs of this machine can make them late or silent, so the best of three minutes counts, but nothing else of it."""
    for number in range(TRIES):
        with created(cluster, f"{place}-{number}") as namespace:
            late = _problems_of_a_minute(cluster, namespace)
        if not late:
            break
    assert late == []


def _problems_of_a_minute(cp: RealNodes, namespace: str) -> list[str]:
    """What can be other programs' doing; no other problem was found."""
    teleop.apply(cp, namespace, teleop.trio())
    names = [app["metadata"]["name"] for app in teleop.trio()]
    assert wait_until(lambda: all(teleop.trips(cp, namespace, name) for name in names), timeout_s=90, poll_s=0.5)
    slow = slowness()
    time.sleep(STABLE_S)
    deadline_us = round(DEADLINE_US * max(slow, slowness()))
    problems = teleop.problems_of_trio(cp, namespace, seconds=STABLE_S, deadline_us=deadline_us)
    assert [each for each in problems if teleop.FOREIGN_HEARD in each or teleop.RESTARTED in each] == []
    return problems


def test_the_command_line_shows_the_logs_and_enters_the_container_of_a_running_app(
    cluster: RealNodes, place: str
) -> None:
    teleop.first_trip_s(cluster, place, teleop.app("pair", nodes={"operator": "edge-1", "robot": "robot-1"}))
    program = Path(sys.executable).parent / "kubectl-robotapp"
    path = f"{cluster.run_dir / 'bin'}:/usr/bin:/bin"
    environment = {"KUBECONFIG": str(cluster.kubeconfig("admin")), "PATH": path, "COLUMNS": "200"}

    def run(*arguments: str) -> str:
        command = [program, "-n", place, *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=60)
        assert done.returncode == 0, done.stderr
        return done.stdout

    lines = run("logs", "pair", "--tail", "5").splitlines()
    assert {line.split(" ")[0] for line in lines} >= {"operator"}
    assert all(" | " in line for line in lines)
    variables = run("exec", "pair", "-c", "operator", "--", "env").splitlines()
    assert f"ROS_DOMAIN_ID={teleop.domain(cluster, place, 'pair')}" in variables
    assert "ROS_SUPER_CLIENT=TRUE" in variables
