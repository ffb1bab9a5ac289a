"""What the demo's steps share: the cluster, our two processes, the network, and small ways to look at them."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from robotapp_testbed import ControlPlane, Process
from robotapp_testbed.browser import LocalConsole
from robotapp_testbed.control_plane.guest import GUEST_LABEL, TOLERATION
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.telemetry import SimulatedTelemetry

ROOT = Path(__file__).resolve().parents[2]
NAMESPACE = "demo"
NAMESPACES = (NAMESPACE, f"{NAMESPACE}-default", f"{NAMESPACE}-ros")
"""All that the story creates: the last two are those of the two schedulers it compares."""
_BIN = Path(sys.executable).parent


@dataclass
class DemoCluster:
    """One run of the demo."""

    cluster: ControlPlane
    operator: Process
    scheduler: Process
    topology: Topology
    telemetry: SimulatedTelemetry
    console: LocalConsole
    confined: bool = False
    """Whether the nodes are guests in somebody's cluster: every app is then kept on them."""

    def kubectl(self, *args: str, stdin: object = None, check: bool = True) -> str:
        return self.cluster.kubectl("-n", NAMESPACE, *args, stdin=stdin, check=check)

    def apply(self, *apps: dict[str, Any], namespace: str = NAMESPACE) -> str:
        """kubectl apply of RobotApps."""
        confined = [confine(app) for app in apps] if self.confined else list(apps)
        return self.cluster.kubectl("-n", namespace, "apply", "-f", "-", stdin=confined)

    def apply_file(self, path: str) -> str:
        """kubectl apply of a file of the repository, as it is unless apps must be confined."""
        if not self.confined:
            return self.kubectl("apply", "-f", str(ROOT / path))
        return self.apply(*yaml.safe_load_all((ROOT / path).read_text()))

    def items(self, kind: str, *args: str, namespace: str = NAMESPACE) -> list[dict[str, Any]]:
        found = json.loads(self.cluster.kubectl("-n", namespace, "get", kind, "-o", "json", *args))
        items: list[dict[str, Any]] = found["items"]
        return items

    def app(self, name: str) -> dict[str, Any]:
        """The RobotApp as stored now; read over one kept connection, so that polling it costs little."""
        path = f"/apis/robotics.io/v1alpha1/namespaces/{NAMESPACE}/robotapps/{name}"
        found: dict[str, Any] = self.cluster.api.get(path)
        return found

    def run(self, program: str, *args: str, stdin: str | None = None) -> str:
        """Run one of our command-line programs as a user would; what it printed, errors included."""
        environment = os.environ | {"KUBECONFIG": str(self.cluster.kubeconfig()), "COLUMNS": "118"}
        done = subprocess.run(
            [str(_BIN / program), *args],
            env=environment,
            input=stdin,
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
            cwd=ROOT,
        )
        return done.stdout + done.stderr

    def robotapp(self, *args: str) -> str:
        return self.run("kubectl-robotapp", *args, "-n", NAMESPACE)


def confine(app: dict[str, Any]) -> dict[str, Any]:
    """The app with every component kept on the simulated nodes, whose taint keeps others away."""
    components = [component | {"template": _confined(component)} for component in app["spec"]["components"]]
    return app | {"spec": app["spec"] | {"components": components}}


def _confined(component: dict[str, Any]) -> dict[str, Any]:
    """The component's `template` with the toleration and the node selector added to what is in it."""
    template = component.get("template", {})
    pod = template.get("spec", {})
    own = {
        "tolerations": [*pod.get("tolerations", []), dict(TOLERATION)],
        "nodeSelector": pod.get("nodeSelector", {}) | {GUEST_LABEL: "true"},
    }
    return {**template, "spec": pod | own}


def condition(app: dict[str, Any], kind: str) -> dict[str, Any]:
    """The named condition of a RobotApp, or an empty one."""
    found: dict[str, Any] = next((c for c in app.get("status", {}).get("conditions", []) if c["type"] == kind), {})
    return found


def is_ready(app: dict[str, Any]) -> bool:
    ready = condition(app, "Ready")
    return ready.get("status") == "True" and ready.get("observedGeneration") == app["metadata"]["generation"]
