"""A plugin of a user's own, in a file of its own: what it reserves travels in the Binding, what it refuses waits."""

import secrets
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from tests.support.stage import Stage, nodes, pod

from robotapp_testbed import ControlPlane
from robotapp_testbed.nodes import edge
from robotapp_testbed.process import Process
from robotapp_testbed.product import start_scheduler

pytestmark = pytest.mark.live

SOURCE = '''
import asyncio

from robotapp_scheduler.core.framework import Code, Status


class Docks:
    """One pod a dock."""

    name = "Docks"

    def __init__(self):
        self.free = ["dock-1"]

    def reserve(self, pod, node, ctx):
        if not self.free:
            return Status(Code.UNSCHEDULABLE, "no dock is free")
        ctx.kept["dock"] = self.free.pop()
        ctx.annotations["lab.example/dock"] = ctx.kept["dock"]

    def unreserve(self, pod, node, ctx):
        self.free += [ctx.kept.pop("dock")] if "dock" in ctx.kept else []

    async def permit(self, pod, node, ctx):
        await asyncio.sleep(0)
        if pod.labels.get("forbidden"):
            return Status(Code.UNSCHEDULABLE, "the dock master said no")

    def post_bind(self, pod, node, ctx):
        print("post_bind", pod.name, node, flush=True)
'''


@pytest.fixture
def docked(installed_plane: ControlPlane, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Process]:
    """A scheduler with the plugin, its Lease given back quickly."""
    module = f"lab_{secrets.token_hex(3)}"
    (tmp_path / f"{module}.py").write_text(SOURCE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    config = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaseDuration": "3s", "renewDeadline": "2s", "retryPeriod": "500ms"},
        "profiles": [
            {
                "schedulerName": "ros-aware-scheduler",
                "plugins": {"multiPoint": {"enabled": [{"name": f"{module}:Docks"}]}},
            }
        ],
    }
    path = tmp_path / "scheduler.yaml"
    path.write_text(yaml.safe_dump(config))
    process = start_scheduler(installed_plane, path, name=f"docked-{module}", log_format="text", insecure_explain=True)
    yield process
    process.stop()


def test_what_a_plugin_reserves_travels_in_the_binding_and_what_it_refuses_waits(
    installed_plane: ControlPlane, stage: Stage, docked: Process
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("forbidden", labels={"forbidden": "yes"}))
        text = stage.wait_refused("forbidden", reason="Unschedulable")
        assert text == "0/1 nodes are available: 1 the dock master said no."
        stage.create_pod(pod("first"))
        assert stage.wait_bound("first") == "edge-1"
        assert stage.pod("first")["metadata"]["annotations"]["lab.example/dock"] == "dock-1"
        stage.wait(lambda: "post_bind first edge-1" in docked.log_text(), what=docked.log_text)
        stage.create_pod(pod("second"))
        assert "1 no dock is free." in stage.wait_refused("second", reason="Unschedulable")
        assert stage.node_of("second") == ""
