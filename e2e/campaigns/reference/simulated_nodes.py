"""Reference applications on simulated nodes: both schedulers, our operator and the control plane are real."""

import json
import secrets
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

from campaigns.nodes import teleop_app
from campaigns.reference.catalogue import Scenario
from campaigns.reference.placement import Json, Placement, describe_decision, list_plugins, list_promises, make_topology
from campaigns.reference.robotapps import make_volume, read_app, read_claims
from campaigns.rigs.ports import ask
from campaigns.scenarios.contenders import OURS, Contender
from robotapp_api.model.names import API_VERSION
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.telemetry import SimulatedTelemetry
from robotapp_testbed.machines.topology import apply as apply_nodes
from robotapp_testbed.processes.process import Process

PLACED_S: Final = 120.0
"""For what takes two seconds on an idle machine, and may run at low priority on a busy one; a pod without a node after that has none."""
GONE_S: Final = 120.0
POLL_S: Final = 1.0
"""Looks of five scenarios, each fifth of a second, would be half of what the API server has to do."""


class Rig:
    """The control plane with all nodes, and our scheduler. Each application has a namespace, in which its volume stays."""

    def __init__(self, cp: ControlPlane, topology: Topology, scheduler: Process, stack: ExitStack) -> None:
        self.cp = cp
        self.topology = topology
        self._scheduler = scheduler
        self._stack = stack
        self._namespaces: dict[str, str] = {}

    def place(self, scenario: Scenario, ros: int, contender: Contender, repetition: int) -> Placement:
        """Applies one application that is prepared, waits for its nodes, and removes it. Several threads may do so, each with its own."""
        name = scenario.app(ros)
        app = read_app(name, scenario.runs_on, scheduler=contender.scheduler_name, use_images=False)
        namespace = self._namespaces[name]
        components = [component["name"] for component in app["spec"]["components"]]
        path = f"/apis/{API_VERSION}/namespaces/{namespace}/robotapps"
        self.cp.api.create(path, app)
        nodes: dict[str, str] = {}

        def are_placed() -> bool:
            nodes.update(self._list_nodes(namespace, name))
            return all(map(nodes.get, components))

        wait_until(are_placed, timeout_s=PLACED_S, poll_s=POLL_S)
        records = self._read_records(namespace, name) if contender is OURS else {}
        self.cp.api.delete(f"{path}/{name}?propagationPolicy=Foreground")
        self._wait_gone(namespace)
        return Placement(
            name,
            contender.name,
            repetition,
            nodes={component: nodes.get(component, "") for component in components},
            promises=list_promises(scenario, app, nodes, self.topology),
            decisions={component: describe_decision(record) for component, record in records.items()},
            plugins=sorted(set().union(*map(list_plugins, records.values()))),
        )

    def prepare(self, scenario: Scenario, ros: int) -> None:
        """Makes the namespace of an application, with the volume that its claim is bound to."""
        name = scenario.app(ros)
        if name in self._namespaces:
            return
        namespace = self._stack.enter_context(created(self.cp, f"{name}-{secrets.token_hex(3)}"))
        claims = read_claims(name)
        volumes = [make_volume(claim, namespace, scenario.volume_node) for claim in claims]
        if claims:
            teleop_app.apply(self.cp, namespace, [*volumes, *claims])
        self._namespaces[name] = namespace

    def _wait_gone(self, namespace: str) -> None:
        """Waits until the places of an application are free for the next one."""
        paths = (f"/apis/{API_VERSION}/namespaces/{namespace}/robotapps", f"/api/v1/namespaces/{namespace}/pods")

        def is_gone() -> bool:
            return not any(self.cp.api.get(path)["items"] for path in paths)

        if not wait_until(is_gone, timeout_s=GONE_S, poll_s=POLL_S):
            raise TestbedError(f"the application in {namespace} is not gone {GONE_S:.0f} s after it was deleted")

    def _list_nodes(self, namespace: str, name: str) -> dict[str, str]:
        pods = teleop_app.pods(self.cp, namespace, name)
        return {component: str(pod["spec"].get("nodeName", "")) for component, pod in pods.items()}

    def _read_records(self, namespace: str, name: str) -> dict[str, Json]:
        """Returns our scheduler's record of each component's pod."""
        records = {}
        for component, pod in teleop_app.pods(self.cp, namespace, name).items():
            status, text = ask(f"{self._scheduler.health_url}/explain/{namespace}/{pod['metadata']['name']}")
            if status == 200:
                records[component] = json.loads(text)
        return records


@contextmanager
def start_rig() -> Iterator[Rig]:
    """Starts the control plane with kube-scheduler, our operator and our scheduler, and simulated nodes with telemetry."""
    topology = make_topology()
    with ExitStack() as stack:
        cp = stack.enter_context(ControlPlane(kube_scheduler=True))
        product.install(cp)
        apply_nodes(cp, topology)
        stack.enter_context(SimulatedTelemetry(cp, topology))
        product.start_operator(cp, sweep_seconds=1, no_leader_election=True)
        yield Rig(cp, topology, product.start_scheduler(cp, insecure_explain=True), stack)
