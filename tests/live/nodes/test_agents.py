"""Agents as the chart installs them, on four real nodes behind the switch: what they measure is what scheduler, status and explain tell."""

import asyncio
import json
import os
import secrets
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from tests.support.clients import client_for
from tests.support.work_unit import slowness

from campaigns.nodes.real_pods import component
from campaigns.rigs.live import Tenant, eventually, pool
from campaigns.rigs.watching import running
from robotapp_api.values.quantities.duration import format_ms
from robotapp_client import Change, Reflector, load
from robotapp_client.api.resources import NODETELEMETRIES
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane import components_as_pods, product
from robotapp_testbed.control_plane.components_as_pods import round_trip
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.machines.nodes import Device, cloud, edge, robot
from robotapp_testbed.processes.process import Process
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

INTERVAL_S = 2
ROUND_TRIP_MS = {
    ("robot-1", "edge-1"): 0,
    ("robot-1", "edge-2"): 2,
    ("edge-1", "cloud-1"): 15,
    ("robot-1", "cloud-1"): 60,
}
JITTER = 0.2
LOSS = 0.01
TRIES = 5
PINGS = 40
READY_S = 120.0
DEVICES = [
    Device("can-can0", "can", interface="can0"),
    Device("serial-0403-6001-a50285bi", "serial", identity="0403:6001:A50285BI"),
]
"""Of robot-1: doubles in its pod's /sys, /dev and /run/udev."""
Json = dict[str, Any]


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes = [robot("robot-1", devices=DEVICES), edge("edge-1"), edge("edge-2", zone="hall-2"), cloud("cloud-1")]
    with real_machine(nodes, delays={}, images=("tools", "agent")) as cp:
        for (one, other), whole_ms in ROUND_TRIP_MS.items():
            cp.switch.set_link(one, other, delay_ms=whole_ms / 2, jitter_ms=JITTER * whole_ms / 2, loss=LOSS)
        components_as_pods.start_agents(cp, interval_s=INTERVAL_S)
        components_as_pods.wait_measured(cp)
        yield cp


@pytest.fixture(scope="module")
def scheduler(cluster: RealNodes) -> Process:
    product.start_operator(cluster)
    return product.start_scheduler(cluster, insecure_explain=True)


@pytest.fixture
def tenant(cluster: RealNodes, scheduler: Process) -> Iterator[Tenant]:
    assert scheduler.running
    with created(cluster, f"agents-{secrets.token_hex(3)}") as namespace:
        yield Tenant(cluster, namespace)


def test_agents_measure_what_ping_sees_in_the_same_minute(cluster: RealNodes) -> None:
    """Other programs of this machine delay one more than the other, so the best of five rounds counts."""
    allowed_us = 300 * slowness()
    seen: dict[tuple[str, str], list[tuple[int | None, int | None]]] = {pair: [] for pair in ROUND_TRIP_MS}
    left = set(ROUND_TRIP_MS)
    for _ in range(TRIES):
        with ThreadPoolExecutor(len(left)) as pool_of_pings:
            found = dict(zip(left, pool_of_pings.map(lambda pair: both_us(cluster, *pair), left), strict=True))
        for pair, (ping_us, told_us) in found.items():
            seen[pair].append((ping_us, told_us))
            if ping_us is not None and told_us is not None and abs(told_us - ping_us) <= 0.1 * ping_us + allowed_us:
                left.remove(pair)
        if not left:
            return
    wrong = {pair: seen[pair] for pair in left}
    pytest.fail(f"ping and agent, in microseconds: {wrong}, allowed are 10 % and {allowed_us:.0f}")


def both_us(cluster: RealNodes, one: str, other: str) -> tuple[int | None, int | None]:
    """The median that ping sees now, and the one that the agent has written."""
    ping_us = cluster.node(one).ping(cluster.node(other), count=PINGS).p50_us
    return ping_us, round_trip(cluster, one, other).get("p50Us")


def app(tenant: Tenant, name: str, ids: str) -> None:
    """A driver on the robot and a panel on edge-2, which must be near."""
    on_edge_2 = {"spec": {"nodeSelector": {"kubernetes.io/hostname": "edge-2"}}}
    tenant.apply(
        name,
        component("panel", template=on_edge_2),
        component("driver", runsOn=["Robot"]),
        robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "robot-1"}}},
        edges=[{"topic": "/cmd_vel", "from": "panel", "to": "driver", "latency": {"budget": "80ms"}}],
        ros2={"pool": ids, "discovery": {"mode": "Multicast"}},  # no image of a discovery server
    )


async def test_scheduler_and_status_tell_a_number_that_an_agent_wrote(
    cluster: RealNodes, scheduler: Process, tenant: Tenant
) -> None:
    written_us: set[int] = set()
    ends = {"robot-1", "edge-2"}

    def collect(change: Change) -> None:
        node = change.new or {"metadata": {"name": ""}}
        for entry in node.get("status", {}).get("rtt", []):
            if {node["metadata"]["name"], entry["peer"]} == ends and "p95Us" in entry:
                written_us.add(entry["p95Us"])

    def ready(ids: str) -> None:
        app(tenant, "teleop", ids)
        tenant.wait_ready("teleop", timeout_s=READY_S)
        tenant.wait("teleop", "BudgetMet", "True", reason="WithinBudget")

    client = client_for(load(cluster.kubeconfig()))
    with pool(cluster, f"agents-{secrets.token_hex(3)}") as ids:
        async with client, running(Reflector(client, NODETELEMETRIES, as_type=dict, on_change=collect)):
            await asyncio.to_thread(ready, ids)
            told = await asyncio.to_thread(status_p95, tenant, "teleop")
            explained = await asyncio.to_thread(explained_us, scheduler, tenant)
        tenant.delete("teleop")
    assert told in {format_ms(us / 1000) for us in written_us}
    assert explained
    assert explained <= written_us


def status_p95(tenant: Tenant, name: str) -> str:
    def look() -> str:
        (instance,) = tenant.instances(name)
        return next((edge["p95"] for edge in instance["status"].get("edges", []) if edge["measured"]), "")

    return eventually(look, what=lambda: tenant.instances(name))


def explained_us(scheduler: Process, tenant: Tenant) -> set[int]:
    """Round trips by which the pods were placed."""
    found = set()
    for pod in tenant.listed("pods"):
        url = f"{scheduler.health_url}/explain/{tenant.namespace}/{pod['metadata']['name']}"
        with urllib.request.urlopen(url, context=unverified()) as answer:  # noqa: S310 - our own
            record = json.load(answer)
        measured = [edge for edge in record["edges"] if edge["source"] == "measured" and edge["peerNode"]]
        found |= {round(1000 * edge["rttMs"]) for edge in measured if edge["rttMs"]}
    return found


def test_a_link_that_is_cut_is_unreachable_within_three_rounds_and_measured_again_after_it(
    cluster: RealNodes, tenant: Tenant
) -> None:
    with pool(cluster, f"agents-{secrets.token_hex(3)}") as ids:
        app(tenant, "cut", ids)
        tenant.wait("cut", "BudgetMet", "True", reason="WithinBudget", timeout_s=READY_S)
        begun = next_round(cluster)
        cluster.switch.set_link("robot-1", "edge-2", down=True)
        try:
            assert rounds_until(cluster, since=begun, answered=False) <= 3
            message = tenant.wait("cut", "BudgetMet", "False", reason="BudgetExceeded")["message"]
            assert "unreachable of 80ms" in message
            begun = next_round(cluster)
        finally:
            cluster.switch.set_link("robot-1", "edge-2", down=False)
        assert rounds_until(cluster, since=begun, answered=True) <= 2
        tenant.delete("cut")


def robots_entry(cluster: RealNodes) -> Json:
    return round_trip(cluster, "robot-1", "edge-2")


def next_round(cluster: RealNodes) -> int:
    """The number of the robot's latest round, right after it was written: not every round is, and the one after it has begun now."""
    before = robots_entry(cluster)["seq"]
    return int(eventually(lambda: (seq := robots_entry(cluster)["seq"]) > before and seq))


def rounds_until(cluster: RealNodes, *, since: int, answered: bool) -> int:
    """How many rounds after that one edge-2 answers the robot, or ceases to."""

    def found() -> Json:
        entry = robots_entry(cluster)
        return entry if entry["seq"] > since and ("p50Us" in entry) is answered else {}

    return int(eventually(found, what=lambda: robots_entry(cluster))["seq"]) - since


def test_a_device_that_an_agent_finds_is_granted_shown_with_its_holder_and_absent_once_it_is_unplugged(
    cluster: RealNodes, tenant: Tenant
) -> None:
    assert {each["id"]: each["present"] for each in reported(cluster, "robot-1")} == dict.fromkeys(
        (each.id for each in DEVICES), True
    )
    driver = component("driver", runsOn=["Robot"], devices=[{"name": "bus", "type": "can", "interface": "can0"}])
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "robot-1"}}}
    with pool(cluster, f"agents-{secrets.token_hex(3)}") as ids:
        tenant.apply("holder", driver, robots=robots, ros2={"pool": ids, "discovery": {"mode": "Multicast"}})
        tenant.wait_ready("holder", timeout_s=READY_S)
        (row,) = [each for each in devices_command(cluster) if each["device"] == "can-can0"]
        assert (row["node"], row["present"], row["holder"]) == ("robot-1", "yes", f"{tenant.namespace}/holder")
        cluster.node("robot-1").devices.unplug("can-can0")
        eventually(lambda: not present(cluster, "can-can0"), what=lambda: reported(cluster, "robot-1"))
        (row,) = [each for each in devices_command(cluster) if each["device"] == "can-can0"]
        assert (row["present"], row["holder"]) == ("no", f"{tenant.namespace}/holder")
        assert present(cluster, "serial-0403-6001-a50285bi")
        tenant.delete("holder")


def test_each_node_has_an_agent_within_its_memory_and_its_telemetry_belongs_to_the_node(cluster: RealNodes) -> None:
    def told() -> bool:
        return len(components_as_pods.usage(cluster, components_as_pods.AGENTS)) == len(cluster.nodes)

    assert wait_until(told, timeout_s=90, poll_s=0.5)
    used = components_as_pods.usage(cluster, components_as_pods.AGENTS).values()
    assert {each.node for each in used} == cluster.nodes.keys()
    assert max(each.rss_bytes for each in used) <= 45e6
    for item in cluster.api.get(components_as_pods.TELEMETRY)["items"]:
        (owner,) = item["metadata"]["ownerReferences"]
        node = cluster.api.get(f"/api/v1/nodes/{item['metadata']['name']}")
        assert (owner["kind"], owner["uid"]) == ("Node", node["metadata"]["uid"])


_TRIES_TO_OPEN = """
import errno, os
assert os.getuid() == 65532
os.listdir("/host/dev"), os.listdir("/host/sys/class")
for path, mode in ("/host/dev/kmsg", "rb"), ("/host/sys/x", "wb"), ("/host/dev/x", "wb"), ("/etc/x", "wb"):
    try:
        open(path, mode)
    except OSError as error:
        assert error.errno in (errno.EPERM, errno.EACCES, errno.EROFS), error
        print("refused", path)
"""


def test_an_agent_cannot_open_a_device_of_its_node_or_write_there(cluster: RealNodes) -> None:
    """It runs in a namespace that allows all of that. One node has doubles of devices, the others this machine's own."""
    for pod in cluster.api.get(f"/api/v1/namespaces/{components_as_pods.AGENTS}/pods")["items"]:
        where = ("exec", "-n", components_as_pods.AGENTS, pod["metadata"]["name"], "--", "python3", "-c")
        refused = [line.split()[1] for line in cluster.kubectl(*where, _TRIES_TO_OPEN).splitlines()]
        assert refused == ["/host/dev/kmsg", "/host/sys/x", "/host/dev/x", "/etc/x"], pod["spec"]["nodeName"]


def reported(cluster: RealNodes, node: str) -> list[Json]:
    found: list[Json] = cluster.api.get(f"{components_as_pods.TELEMETRY}/{node}")["status"]["devices"]
    return found


def present(cluster: RealNodes, device_id: str) -> bool:
    (found,) = [each["present"] for each in reported(cluster, "robot-1") if each["id"] == device_id]
    return bool(found)


def devices_command(cluster: RealNodes) -> list[Json]:
    """What `kubectl robotapp devices` shows."""
    program = Path(sys.executable).parent / "kubectl-robotapp"
    environment = {**os.environ, "KUBECONFIG": str(cluster.kubeconfig())}
    done = subprocess.run(
        [program, "devices", "-o", "json"], env=environment, capture_output=True, text=True, check=True
    )
    rows: list[Json] = json.loads(done.stdout)["devices"]
    return rows
