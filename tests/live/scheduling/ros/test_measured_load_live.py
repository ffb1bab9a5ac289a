"""LoadBalanceScore with `source: Telemetry`: what agents measure decides, and requests where no agent is heard."""

import json
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest
import yaml

from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_api.model.names import Annotation
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.machines.telemetry import SimulatedTelemetry

pytestmark = pytest.mark.live

NAMES = ("load-a", "load-b", "load-c")
CONTROL = {str(Annotation.POLICIES): json.dumps({"qos_class": "realtime"})}
DOCUMENT = {
    "apiVersion": "kubescheduler.config.k8s.io/v1",
    "kind": "KubeSchedulerConfiguration",
    "profiles": [
        {
            "schedulerName": "ros-aware-scheduler",
            "plugins": {"score": {"disabled": [{"name": "*"}], "enabled": [{"name": "LoadBalanceScore", "weight": 1}]}},
            "pluginConfig": [{"name": "LoadBalanceScore", "args": {"source": "Telemetry"}}],
        }
    ],
}


@pytest.fixture(scope="module", autouse=True)
def _scheduler(installed_plane: ControlPlane, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    config: Path = tmp_path_factory.mktemp("measured-load") / "scheduler.yaml"
    config.write_text(yaml.safe_dump(DOCUMENT))
    process = start_scheduler(installed_plane, config, name="scheduler-load", sweep_seconds=1, log_format="text")
    yield
    process.stop()


@pytest.fixture
def agents(installed_plane: ControlPlane) -> Iterator[SimulatedTelemetry]:
    topology = Topology([edge(name) for name in NAMES])
    with nodes(installed_plane, *topology), SimulatedTelemetry(installed_plane, topology, interval_s=2) as found:
        yield found


class Pods:
    """Small pods, one after the other."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._numbers = count()

    def place(self, *, cpu: str = "1m") -> str:
        """Where the next one goes."""
        name = f"p{next(self._numbers)}"
        self._stage.create_pod(pod(name, requests={"cpu": cpu, "memory": "1Mi"}, annotations=CONTROL))
        return self._stage.wait_bound(name)

    def settle(self, node: str) -> None:
        """Within seconds they go there, and go on to do so."""
        until = time.monotonic() + 60
        while (found := self.place()) != node:
            assert time.monotonic() < until, f"pods go to {found} and not to {node}"
            time.sleep(0.2)
        assert [self.place() for _ in range(3)] == [node] * 3


def test_pods_follow_the_load_that_agents_measure_and_requests_where_none_is_heard(
    stage: Stage, agents: SimulatedTelemetry
) -> None:
    pods = Pods(stage)
    agents.set_load("load-a", cpu=90, memory=90)
    agents.set_load("load-b", cpu=20, memory=20)
    agents.set_load("load-c", cpu=50, memory=50)
    pods.settle("load-b")
    agents.set_load("load-b", cpu=95, memory=95)
    pods.settle("load-c")
    agents.set_load("load-a", cpu=5, memory=5)
    pods.settle("load-a")
    agents.set_load("load-a", cpu=90, memory=90)
    pods.settle("load-c")
    agents.silence("load-b")  # measured 95 % last; what counts once it is silent are its requests, next to none
    pods.settle("load-b")


def test_requests_count_on_a_node_whose_agent_reports_no_load(stage: Stage, agents: SimulatedTelemetry) -> None:
    pods = Pods(stage)
    agents.set_load("load-a", cpu=30, memory=30)
    agents.set_load("load-b", cpu=60, memory=60)
    pods.settle("load-c")
    pods.place(cpu="15")  # of the 16 of load-c
    pods.settle("load-a")
