"""An app planned whole by the worker on a real API server, and placed all the same when the worker is killed."""

import json
import os
import re
import signal
from itertools import product
from pathlib import Path

import pytest
from tests.support.apiobjects import component

from campaigns.rigs.ports import ask
from campaigns.rigs.stage import Json, Stage, deployment, nodes
from robotapp_api.model.names import API_VERSION, Annotation, Label
from robotapp_scheduler.shell.planner.planner import WORKER
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import SimulatedNode, edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live
TELEMETRY = f"/apis/{API_VERSION}/nodetelemetries"
EDGES = (("camera", "vision"), ("vision", "planner"), ("planner", "driver"), ("operator", "driver"), ("map", "planner"))
PINNED = {"camera": "robot", "driver": "robot", "operator": "desk"}
NEAR = ("robot", "desk", "e1", "e2", "e3")
RTT_MS = {
    ("robot", "e1"): 12, ("robot", "e2"): 14, ("robot", "e3"): 55, ("robot", "desk"): 30, ("e1", "e2"): 25,
    ("e1", "e3"): 9, ("e1", "desk"): 22, ("e2", "e3"): 28, ("e2", "desk"): 6, ("e3", "desk"): 40,
}  # fmt: skip
TRIES = 8
FAR = 40
"""So many nodes that cannot be reached in time make the problem one for the worker."""


def rtt_ms(a: str, b: str) -> int:
    return 0 if a == b else RTT_MS.get((a, b), RTT_MS.get((b, a), 1000))


def wire_ms(where: dict[str, str]) -> int:
    return sum(rtt_ms(where[start], where[end]) for start, end in EDGES)


def least_wire_ms() -> int:
    """Every node holds two pods."""
    every = ({**PINNED, "vision": a, "planner": b, "map": c} for a, b, c in product(NEAR, repeat=3))
    return min(wire_ms(where) for where in every if all(list(where.values()).count(node) <= 2 for node in NEAR))


def measure(cp: ControlPlane) -> None:
    """What the agents of the near nodes report, good for five minutes; it goes with the nodes."""
    for name in NEAR:
        rtt = [{"peer": peer, "p50Us": 1000 * rtt_ms(name, peer), "p95Us": 1000 * rtt_ms(name, peer)}
               for peer in NEAR if peer != name]  # fmt: skip
        rtt += [{"peer": f"far-{i}", "p50Us": 500_000, "p95Us": 500_000} for i in range(FAR)]
        cp.api.create(TELEMETRY, {"apiVersion": API_VERSION, "kind": "NodeTelemetry", "metadata": {"name": name}})
        cp.api.patch(f"{TELEMETRY}/{name}/status", {"status": {"intervalSeconds": 100, "seq": 1, "rtt": rtt}})


def create(stage: Stage, name: str, *, pinned: dict[str, str]) -> None:
    names = dict.fromkeys(end for ends in EDGES for end in ends)
    edges: list[Json] = [
        {"topic": f"/{start}", "from": start, "to": end, "latency": {"budget": "60ms"}} for start, end in EDGES
    ]
    app = stage.create_app(name, [component(each) for each in names], edges=edges)
    for each in names:
        where = {"nodeSelector": {"kubernetes.io/hostname": pinned[each]}} if each in pinned else {}
        box = {"name": "main", "image": "registry.invalid/main:1", "resources": {"requests": {"cpu": "1"}}}
        stage.create_deployment(deployment(app, each, containers=[box], **where))


def placed(stage: Stage, app: str) -> dict[str, str]:
    pods = stage.pods(**{str(Label.APP): app})
    return {p["metadata"]["labels"][str(Label.COMPONENT)]: p["spec"].get("nodeName", "") for p in pods}


def wait_placed(stage: Stage, app: str) -> dict[str, str]:
    def whole() -> bool:
        where = placed(stage, app)
        return len(where) == 6 and all(where.values())

    stage.wait(whole, what=lambda: f"{app}: {placed(stage, app)}", timeout_s=120)
    return placed(stage, app)


def try_for_the_least(stage: Stage, scheduler: Process) -> list[int]:
    """The wire of some apps, one after the other, until one has the least there is.

    A search ends after a tenth of a second, whatever a busy machine left it of that; what its plan is worth it says.
    """
    found: list[int] = []
    for number in range(TRIES):
        name = f"teleop-{number}"
        create(stage, name, pinned=PINNED)
        found.append(wire_ms(wait_placed(stage, name)))
        said = how_planned(stage, name, scheduler)
        better = re.search(r"no plan was more than (\d+) % better", said)
        if found[-1] == least_wire_ms() and (better or "no plan was better" in said):
            break
        assert better, f"{found[-1]} ms instead of {least_wire_ms()}: {said}"
        stage.cp.kubectl("delete", "deployments,robotapps", "--all", "-n", stage.namespace)
        stage.wait(lambda: not stage.pods(), what=lambda: f"left: {stage.pods()}")
    return found


def how_planned(stage: Stage, app: str, scheduler: Process) -> str:
    """What the explanation of a pod of the app says of the plan it followed."""
    first = stage.pods(**{str(Label.APP): app})[0]["metadata"]["name"]
    status, text = ask(f"{scheduler.health_url}/explain/{stage.namespace}/{first}")
    assert status == 200, text
    return str(json.loads(text)["planned"])


def workers(process: Process) -> list[int]:
    """The scheduler's child processes that plan; another one serves its port."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(pid) for pid in children if WORKER[-1].encode() in Path(f"/proc/{pid}/cmdline").read_bytes()]


def world(*, cpu: str) -> list[SimulatedNode]:
    far = [edge(f"far-{i}", cpu=cpu, zone="far") for i in range(FAR)]
    return [*(edge(name, cpu=cpu, zone=f"zone-{name}") for name in NEAR), *far]


def test_six_components_get_the_least_rtt_and_a_killed_worker_holds_nobody(
    installed_plane: ControlPlane, stage: Stage, scheduler: Process
) -> None:
    with nodes(installed_plane, *world(cpu="2")):
        measure(installed_plane)
        found = try_for_the_least(stage, scheduler)
        assert found[-1] == least_wire_ms(), found
        (worker,) = workers(scheduler)
    with nodes(installed_plane, *world(cpu="16")):
        measure(installed_plane)
        os.kill(worker, signal.SIGKILL)
        create(stage, "again", pinned=PINNED)
        assert wire_ms(wait_placed(stage, "again")) <= 2 * least_wire_ms()


# --- As large as an app may be ---------------------------------------------------------------------------------------

HALL = ("h1", "h2", "h3", "h4")
CLOUD_MS, HALL_MS = 60, 15
RING = 64


def measure_hall(cp: ControlPlane) -> None:
    """Every machine of the hall has measured all others and the cloud."""
    for name in HALL:
        peers = {peer: HALL_MS for peer in HALL if peer != name} | {"far-cloud": CLOUD_MS}
        rtt = [{"peer": peer, "p50Us": 1000 * ms, "p95Us": 1000 * ms} for peer, ms in peers.items()]
        cp.api.create(TELEMETRY, {"apiVersion": API_VERSION, "kind": "NodeTelemetry", "metadata": {"name": name}})
        cp.api.patch(f"{TELEMETRY}/{name}/status", {"status": {"intervalSeconds": 100, "seq": 1, "rtt": rtt}})


@pytest.mark.usefixtures("scheduler")
def test_a_ring_of_sixty_four_components_runs_on_nodes_of_which_one_is_too_far(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    """A ring is the hardest order to walk: whoever comes last has two neighbours that stand already."""
    hall = [edge(name, cpu="4", zone="hall") for name in HALL]
    with nodes(installed_plane, *hall, edge("far-cloud", cpu="64", zone="far")):
        measure_hall(installed_plane)
        names = [f"c{i}" for i in range(RING)]
        edges: list[Json] = [
            {"topic": f"/t{i}", "from": name, "to": names[(i + 1) % RING], "latency": {"budget": "30ms"}}
            for i, name in enumerate(names)
        ]
        app = stage.create_app("ring", [component(name) for name in names], edges=edges)
        box = {"name": "main", "image": "registry.invalid/main:1", "resources": {"requests": {"cpu": "1m"}}}
        installed_plane.api.each(lambda name: stage.create_deployment(deployment(app, name, containers=[box])), names)

        def whole() -> bool:
            where = placed(stage, "ring")
            return len(where) == RING and all(where.values())

        stage.wait(whole, what=lambda: f"{placed(stage, 'ring')}", timeout_s=120)
        where = placed(stage, "ring")
        assert len({node == "far-cloud" for node in where.values()}) == 1, where


@pytest.mark.usefixtures("scheduler")
def test_an_app_waits_while_a_robots_link_does_not_carry_its_stream_and_starts_when_it_does(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    """24 Mbit/s from a camera on the robot to a component that only the server has room for."""
    edges: list[Json] = [{"topic": "/image", "from": "camera", "to": "vision", "rateHz": 30, "messageBytes": 100_000}]
    wants = {"camera": ("robot", "1"), "vision": ("server", "8")}
    with nodes(installed_plane, edge("robot", cpu="2"), edge("server", cpu="16")):
        installed_plane.kubectl("annotate", "node", "robot", f"{Annotation.LINK_BANDWIDTH}=20M")
        app = stage.create_app("stream", [component(name) for name in wants], edges=edges)
        for name, (node, cpu) in wants.items():
            box = {"name": "main", "image": "registry.invalid/main:1", "resources": {"requests": {"cpu": cpu}}}
            where = {"nodeSelector": {"kubernetes.io/hostname": node}} if name == "camera" else {}
            stage.create_deployment(deployment(app, name, containers=[box], **where))

        def refusals() -> str:
            found = stage.pods(**{str(Label.APP): "stream"})
            return " ".join(each.get("message", "") for pod in found for each in pod["status"].get("conditions", []))

        stage.wait(lambda: "too little bandwidth on an access link" in refusals(), what=refusals)
        assert set(placed(stage, "stream").values()) == {""}
        installed_plane.kubectl("annotate", "--overwrite", "node", "robot", f"{Annotation.LINK_BANDWIDTH}=30M")
        expected = {name: node for name, (node, _) in wants.items()}
        stage.wait(lambda: placed(stage, "stream") == expected, what=lambda: f"{placed(stage, 'stream')} {refusals()}")
