"""kubectl-robotapp as a user runs it, on the real control plane with operator and scheduler."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import yaml

from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.nodes import Device, edge
from robotapp_testbed.machines.telemetry import SimulatedTelemetry
from robotapp_testbed.machines.topology import apply, fleet, remove

pytestmark = pytest.mark.live

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
PROGRAM = Path(sys.executable).parent / "kubectl-robotapp"
NAMESPACE = "fleet-a"


@dataclass
class CliUser:
    plane: ControlPlane
    scheduler_url: str

    def run(
        self, *arguments: str, identity: str = "admin", stdin: str | None = None
    ) -> subprocess.CompletedProcess[str]:
        environment = {
            "KUBECONFIG": str(self.plane.kubeconfig(identity)),
            "COLUMNS": "150",
            "PYTHONIOENCODING": "utf-8",
            "PATH": "/usr/bin:/bin",
        }
        return subprocess.run(
            [PROGRAM, *arguments], env=environment, input=stdin, capture_output=True, text=True, check=False
        )

    def completed(self, *words: str) -> list[str]:
        """What kubectl's own completion gets for `kubectl robotapp WORD…`, as a shell asks it on TAB."""
        path = f"{PROGRAM.parent}:{self.plane.run_dir / 'bin'}:/usr/bin:/bin"
        environment = {"KUBECONFIG": str(self.plane.kubeconfig("admin")), "PATH": path, "HOME": str(self.plane.run_dir)}
        command = ["kubectl", "__complete", "robotapp", *words]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return done.stdout.splitlines()

    def text(self, *arguments: str) -> str:
        done = self.run(*arguments, "-n", NAMESPACE)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def cluster(self, *arguments: str) -> str:
        """Of a command that looks at the whole cluster."""
        done = self.run(*arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def app(self, name: str) -> Any:
        return json.loads(self.plane.kubectl("get", "robotapp", name, "-n", NAMESPACE, "-o", "json"))


@pytest.fixture(scope="module")
def world() -> Iterator[CliUser]:
    topology = fleet(
        robots=["amr-07", "amr-08"],
        edges=2,
        clouds=1,
        devices={"amr-07": [Device(id="can-can0", type="can", interface="can0")]},
    )
    with ControlPlane(kwok=True, controller_manager=True, audit=True) as plane:
        product.install(plane)
        apply(plane, topology)
        with SimulatedTelemetry(plane, topology):
            product.start_operator(plane)
            scheduler = product.start_scheduler(plane)
            plane.kubectl("create", "namespace", NAMESPACE)
            for name in ("teleop", "can-holder"):
                plane.kubectl("apply", "-n", NAMESPACE, "-f", str(EXAMPLES / f"{name}.yaml"))
            found = CliUser(plane, str(scheduler.health_url))
            for name in ("teleop", "can-holder"):
                await_ready(found, name)
            plane.kubectl("apply", "-n", NAMESPACE, "-f", str(EXAMPLES / "can-rival.yaml"))
            yield found


def await_ready(world: CliUser, name: str) -> None:
    until = time.monotonic() + 120
    while not any(c["type"] == "Ready" and c["status"] == "True" for c in world.app(name)["status"]["conditions"]):
        assert time.monotonic() < until, world.app(name)["status"]
        time.sleep(0.2)


def test_explain_names_the_node_that_is_too_far_with_its_latency(world: CliUser) -> None:
    text = world.text("explain", "teleop", "--scheduler-url", world.scheduler_url)
    assert "cloud-1: 60.0 ms to amr-07 > 30 ms" in text
    assert "/cmd_vel" in text
    assert "records" not in text, "the scheduler's own records are shown, no fallback"


def test_explain_shows_how_old_each_measurement_is_and_the_figure_of_the_status(world: CliUser) -> None:
    def shown() -> re.Match[str] | None:
        text = world.text("explain", "teleop", "--scheduler-url", world.scheduler_url)
        return re.search(r"/cmd_vel .* (\S+)/30 ms .*measured (\d+)s ago", text)

    assert wait_until(lambda: shown() is not None, timeout_s=60)
    found = shown()
    assert found is not None
    assert int(found[2]) <= 30, "a heartbeat every ten seconds, and unknown after three"
    budget = world.app("teleop")["status"]["summary"]["budget"]
    assert budget == f"{found[1]}/30ms"


def test_explain_without_the_scheduler_says_so_and_shows_the_nodes(world: CliUser) -> None:
    text = world.text("explain", "teleop")
    assert "no scheduler pod runs in namespace robotapp-system" in text
    assert "amr-07" in text


def test_explain_of_a_waiting_app_names_what_is_missing(world: CliUser) -> None:
    until = time.monotonic() + 120
    while "no free device" not in (text := world.text("explain", "can-rival", "--scheduler-url", world.scheduler_url)):
        assert time.monotonic() < until, text
        time.sleep(0.2)
    assert "waiting" in text
    assert "amr-07: had no free device for the pod" in text


def test_list_and_info_show_what_kubectl_get_shows(world: CliUser) -> None:
    domain = world.app("teleop")["status"]["summary"]["domain"]
    row = next(line for line in world.text("list").splitlines() if line.startswith("teleop"))
    assert row.split()[1:4] == ["2/2", "Running", domain]
    info = world.text("info", "teleop")
    assert f"robot amr-07, domain {domain}" in info
    assert "DomainAllocated" in info


def test_info_shows_what_the_instance_objects_say(world: CliUser) -> None:
    def observed() -> list[
        dict[str, Any]
    ]:  # the object comes after the app's status, and its own status after the object
        shown = world.plane.kubectl("get", "robotappinstances", "-n", NAMESPACE, "-o", "json")
        found = [item for item in json.loads(shown)["items"] if item["spec"]["app"] == "teleop"]
        return [item for item in found if "components" in item.get("status", {})]

    assert wait_until(lambda: bool(observed()), timeout_s=60)
    (instance,) = observed()
    found = json.loads(world.text("info", "teleop", "-o", "json", "--robot", "amr-07"))
    assert found["app"]["metadata"]["uid"] == instance["spec"]["appUID"]
    assert [each["metadata"]["uid"] for each in found["instances"]] == [instance["metadata"]["uid"]]
    text = world.text("info", "teleop")
    assert all(item["name"] in text for item in instance["status"]["components"])
    missing = world.run("info", "teleop", "--robot", "amr-08", "-n", NAMESPACE)
    assert (missing.returncode, "it has: amr-07" in missing.stderr) == (4, True)


def test_an_instance_object_that_somebody_deleted_is_no_reason_to_fail(world: CliUser) -> None:
    world.plane.kubectl("delete", "robotappinstances", "-n", NAMESPACE, "-l", "robotics.io/app=teleop", "--wait=false")
    assert "teleop" in world.text("info", "teleop")
    assert "amr-07" in world.text("explain", "teleop", "--scheduler-url", world.scheduler_url)
    until = time.monotonic() + 60
    while "robot amr-07, domain" not in world.text("info", "teleop"):
        assert time.monotonic() < until, world.text("info", "teleop")
        time.sleep(0.2)


def test_kubectl_completes_our_commands_and_the_names_in_the_cluster(world: CliUser) -> None:
    assert world.completed("expl")[0].startswith("explain\t")
    assert world.completed("info", "-n", NAMESPACE, "te") == ["teleop", ":4"]
    assert world.completed("info", "-n", NAMESPACE, "teleop", "--robot", "a") == ["amr-07", ":4"]


def test_what_if_shows_where_a_pod_would_go_and_which_budget_would_break_and_writes_nothing(
    world: CliUser, tmp_path: Path
) -> None:
    here = next(node for node in nodes_of(world, "teleop").values() if node.startswith("edge"))
    there = {"edge-1": "edge-2", "edge-2": "edge-1"}[here]
    before = versions(world)

    def asked(*arguments: str) -> Any:
        return json.loads(world.text("what-if", *arguments, "-o", "json", "--scheduler-url", world.scheduler_url))

    lost = asked("--node-loss", here)
    moved = {each["component"]: (each["outcome"], each["from"], each["to"]) for each in lost["pods"]}
    assert moved.pop("operator-ui") == ("Moves", here, there)
    assert not moved.keys() - {""}, "beside it only the app's discovery servers may have been there"
    slow = asked("--rtt", f"{here}:amr-07=90ms")
    assert {each["edge"]: (each["before"]["verdict"], each["after"]) for each in slow["edges"]} == dict.fromkeys(
        ("/cmd_vel", "/odom"), ("Met", {"rttMs": 90.0, "source": "measured", "verdict": "Exceeded"})
    )
    assert [(each["outcome"], each["to"]) for each in slow["pods"]] == [("MayMove", there)]
    config = tmp_path / "config.yaml"
    config.write_text("{apiVersion: kubescheduler.config.k8s.io/v1, kind: KubeSchedulerConfiguration}")
    assert asked("--replay", "50", "--config", str(config))["replayed"] >= len(nodes_of(world, "teleop"))
    wrong = world.run("what-if", "--node-loss", "edge-9", "-n", NAMESPACE, "--scheduler-url", world.scheduler_url)
    assert (wrong.returncode, "did you mean edge-" in wrong.stderr) == (4, True), wrong.stderr
    tenant = world.run("what-if", "--node-loss", here, "--scheduler-url", world.scheduler_url, identity="tenant")
    assert (tenant.returncode, "you may not get" in tenant.stderr) == (1, True), tenant.stderr
    assert versions(world) == before


def nodes_of(world: CliUser, app: str) -> dict[str, str]:
    """The node of each component."""
    pods = world.plane.kubectl("get", "pods", "-n", NAMESPACE, "-l", f"robotics.io/app={app}", "-o", "json")
    return {
        pod["metadata"]["labels"]["robotics.io/component"]: pod["spec"].get("nodeName", "")
        for pod in json.loads(pods)["items"]
        if "robotics.io/component" in pod["metadata"]["labels"]
    }


def versions(world: CliUser) -> dict[str, str]:
    """The resourceVersion of everything that a decision could write."""
    kinds = "pods,deployments,robotapps,robotclaims,events.v1.events.k8s.io"
    found = json.loads(world.plane.kubectl("get", kinds, "-n", NAMESPACE, "-o", "json"))["items"]
    return {each["metadata"]["uid"]: each["metadata"]["resourceVersion"] for each in found}


def test_domains_and_devices_name_their_holders(world: CliUser) -> None:
    domain = world.app("teleop")["status"]["summary"]["domain"]
    assert [domain, "default", f"{NAMESPACE}/teleop"] in [
        line.split()[:3] for line in world.text("domains").splitlines()
    ]
    (device,) = json.loads(world.text("devices", "-o", "json"))["devices"]
    assert (device["node"], device["device"], device["holder"]) == ("amr-07", "can-can0", f"{NAMESPACE}/can-holder")


def test_nodes_and_robots_show_what_the_agents_wrote_and_how_old_it_is(world: CliUser) -> None:
    found = {row["node"]: row for row in json.loads(world.cluster("nodes", "-o", "json"))["nodes"]}
    robot = found["amr-07"]
    assert (robot["tier"], robot["robot"], robot["ready"], robot["silent"]) == ("robot", "amr-07", True, False)
    assert robot["devices"] == {"free": 0, "held": 1}
    assert robot["rttP95"].endswith("ms")
    assert abs(time.time() - datetime.fromisoformat(robot["reportedAt"]).timestamp()) < 3600
    robots = json.loads(world.cluster("robots", "-o", "json"))["robots"]
    assert [row["robot"] for row in robots] == ["amr-07", "amr-08"]
    assert world.cluster("nodes").splitlines()[0].split()[:3] == ["NODE", "TIER", "ZONE"]


def test_nodes_need_the_right_to_see_the_cluster(world: CliUser) -> None:
    done = world.run("nodes", identity="tenant")
    assert done.returncode == 1
    assert "nodes" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_node_without_an_agent_shows_the_devices_its_labels_name(world: CliUser) -> None:
    lonely = edge("edge-lonely", devices=[Device(id="can-can1", type="can", interface="can1")])
    apply(world.plane, [lonely])
    try:
        rows = json.loads(world.cluster("devices", "-o", "json"))["devices"]
        assert [(row["device"], row["source"], row["present"]) for row in rows if row["node"] == lonely.name] == [
            ("can-can1", "label", "yes")
        ]
        (row,) = [
            row for row in json.loads(world.cluster("nodes", "-o", "json"))["nodes"] if row["node"] == lonely.name
        ]
        assert (row["devices"], row["reportedAt"]) == ({"free": 1, "held": 0}, "")
    finally:
        remove(world.plane, [lonely])


def test_what_render_shows_can_be_applied_again_without_a_change(world: CliUser) -> None:
    documents = list(yaml.safe_load_all(world.text("render", "teleop")))
    assert {"Deployment", "Service"} <= {item["kind"] for item in documents}
    diff = world.plane.kubectl(
        "diff", "--server-side", "--field-manager=robotapp-operator", "-f", "-", stdin=documents, check=False
    )
    assert diff == ""


def test_render_of_a_file_shows_the_defaults_and_stores_nothing(world: CliUser) -> None:
    done = world.run("render", "-f", str(EXAMPLES / "minimal.yaml"), "-n", "default")
    assert done.returncode == 0, done.stderr
    (app,) = yaml.safe_load_all(done.stdout)
    assert app["spec"]["components"][0]["qosClass"] == "system_default"
    assert "minimal" not in world.plane.kubectl("get", "robotapps", "-n", "default", "-o", "name")


def test_render_of_a_wrong_file_names_the_field(world: CliUser) -> None:
    text = (EXAMPLES / "minimal.yaml").read_text().replace("image:", "imgae:")
    done = world.run("render", "-f", "-", "-n", "default", stdin=text)
    assert done.returncode == 1
    assert "imgae" in done.stderr
    assert "Traceback" not in done.stderr


def test_lint_finds_what_the_server_refuses_and_asks_nobody(world: CliUser) -> None:
    text = (EXAMPLES / "minimal.yaml").read_text().replace("image:", "imgae:")
    done = world.run("lint", "-", identity="tenant", stdin=text)
    assert done.returncode == 1
    assert "unknown field; did you mean image?" in done.stdout
    assert world.run("lint", *map(str, sorted(EXAMPLES.glob("*.yaml")))).returncode == 0


def test_a_tenant_is_told_what_to_ask_for(world: CliUser) -> None:
    done = world.run("domains", identity="tenant")
    assert done.returncode == 1
    assert "robotapp-cluster-viewer" in done.stderr


def test_our_processes_were_refused_nothing_by_the_charts_roles(world: CliUser) -> None:
    ours = [
        event
        for event in world.plane.audit()
        if event["user"]["username"].startswith("system:serviceaccount:robotapp-system:")
    ]
    assert len(ours) > 50
    refused = [
        (event["user"]["username"], event["verb"], event["requestURI"])
        for event in ours
        if (event.get("responseStatus") or {}).get("code") in (401, 403)
    ]
    assert refused == []


def pod_uids(world: CliUser, app: str) -> set[str]:
    """Returns the uids of the app's pods that are not being deleted."""
    pods = json.loads(world.plane.kubectl("get", "pods", "-n", NAMESPACE, "-l", f"robotics.io/app={app}", "-o", "json"))
    return {pod["metadata"]["uid"] for pod in pods["items"] if "deletionTimestamp" not in pod["metadata"]}


def test_an_app_is_restarted_suspended_and_resumed_and_keeps_its_domain(world: CliUser) -> None:
    domain = world.app("teleop")["status"]["summary"]["domain"]
    uids = pod_uids(world, "teleop")
    assert "are replaced" in world.text("restart", "teleop", "driver")
    assert wait_until(lambda: len(pod_uids(world, "teleop") - uids) == 1, timeout_s=60), "one component, one pod"
    await_ready(world, "teleop")

    assert "keeps its domain" in world.text("suspend", "teleop")
    assert wait_until(lambda: not pod_uids(world, "teleop"), timeout_s=60)
    assert wait_until(lambda: world.app("teleop")["status"]["phase"] == "Suspended", timeout_s=60)
    refusal = world.run("logs", "teleop", "-n", NAMESPACE)
    assert (refusal.returncode, "kubectl robotapp resume teleop" in refusal.stderr) == (4, True)

    world.text("resume", "teleop")
    await_ready(world, "teleop")
    assert world.app("teleop")["status"]["summary"]["domain"] == domain
