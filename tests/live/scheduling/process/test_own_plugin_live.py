"""A plugin of a user's own, in a file of its own: what it reserves travels in the Binding, what it refuses waits, and one
that does not come back holds up nobody else for long.
"""

import os
import secrets
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

SOURCE = '''
import asyncio

from robotapp_scheduler.core.framework.interface import Code, Status


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


COURIER = '''
from robotapp_scheduler.core.framework.interface import Code, Status


class Courier:
    """Binds the pods that ask for it, and leaves the others to the next bind plugin."""

    name = "Courier"

    async def bind(self, pod, node, ctx):
        if pod.labels.get("courier") == "ill":
            raise OSError("the courier is ill")
        if "courier" not in pod.labels:
            return Status(Code.SKIP)
        ctx.annotations["lab.example/by"] = "courier"
        return await ctx.handle.pods.bind(
            pod.pod, node, annotations=ctx.binding_annotations, resource_version=ctx.reserved.resource_version
        )
'''


WAITS = '''
import numpy as np


class Waits:
    """For an answer that never comes; or, worse, whatever is tried against it."""

    name = "Waits"
    reads = ("labels",)

    def filter(self, pod, nodes):
        while pod.labels.get("patience"):
            try:
                while True:
                    pass
            except BaseException:
                if pod.labels["patience"] != "endless":
                    raise
        return np.ones(nodes.n, dtype=bool)
'''


DIES = '''
import os
import signal

import numpy as np


class Dies:
    """Ends the process without a word, as native code does that crashes."""

    name = "Dies"
    reads = ("labels",)

    def filter(self, pod, nodes):
        if pod.labels.get("deadly"):
            os.kill(os.getpid(), signal.SIGKILL)
        return np.ones(nodes.n, dtype=bool)
'''


Lists = Callable[[str], dict[str, Any]]
"""The `plugins` of a profile, with a plugin of this name."""


def everywhere(name: str) -> dict[str, Any]:
    return {"multiPoint": {"enabled": [{"name": name}]}}


def before_the_default(name: str) -> dict[str, Any]:
    listed = [{"name": name}, {"name": "DefaultBinder"}]
    return {"bind": {"enabled": listed, "disabled": [{"name": "*"}]}}


def without_ours(name: str) -> dict[str, Any]:
    listed = [{"name": each} for each in (name, "PrioritySort", "NodeResourcesFit", "DefaultBinder")]
    return {"multiPoint": {"enabled": listed, "disabled": [{"name": "*"}]}}


@pytest.fixture
def start(
    installed_plane: ControlPlane, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Process]]:
    """Starts a scheduler with a plugin of this source and name; all of a test share their folder of deaths and hold the Lease as one."""
    started: list[Process] = []
    module = f"lab_{secrets.token_hex(3)}"

    def started_with(source: str, plugin: str, *, wait: bool = True, plugins: Lists = everywhere) -> Process:
        (tmp_path / f"{module}.py").write_text(source)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
        config = {
            "apiVersion": "kubescheduler.config.k8s.io/v1",
            "kind": "KubeSchedulerConfiguration",
            "leaderElection": {"retryPeriod": "500ms"},
            "profiles": [
                {
                    "schedulerName": "ros-aware-scheduler",
                    "plugins": plugins(f"{module}:{plugin}"),
                }
            ],
        }
        path = tmp_path / f"{module}.yaml"
        path.write_text(yaml.safe_dump(config))
        process = start_scheduler(
            installed_plane,
            path,
            name=f"{module}-{len(started)}",
            env={"POD_NAME": module},
            wait=wait,
            log_format="text",
            insecure_explain=True,
            state_dir=tmp_path / "state",
        )
        started.append(process)
        return process

    yield started_with
    for process in started:
        process.stop()


def test_what_a_plugin_reserves_travels_in_the_binding_and_what_it_refuses_waits(
    installed_plane: ControlPlane, stage: Stage, start: Callable[..., Process]
) -> None:
    docked = start(SOURCE, "Docks")
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("forbidden", labels={"forbidden": "yes"}))
        text = stage.wait_refused("forbidden", reason="Unschedulable", saying="1 the dock")
        assert text == "0/1 nodes are available: 1 the dock master said no."
        stage.create_pod(pod("first"))
        assert stage.wait_bound("first") == "edge-1"
        assert stage.pod("first")["metadata"]["annotations"]["lab.example/dock"] == "dock-1"
        stage.wait(lambda: "post_bind first edge-1" in docked.log_text(), what=docked.log_text)
        stage.create_pod(pod("second"))
        assert "1 no dock is free." in stage.wait_refused("second", reason="Unschedulable")
        assert stage.node_of("second") == ""


def test_a_bind_plugin_binds_what_it_does_not_skip_grants_included_and_is_named_where_it_fails(
    installed_plane: ControlPlane, stage: Stage, start: Callable[..., Process]
) -> None:
    start(COURIER, "Courier", plugins=before_the_default)
    with nodes(installed_plane, edge("edge-1")):
        domain = {str(Annotation.DDS_DOMAIN): "auto"}
        stage.create_pod(pod("carried", labels={"courier": "yes"}, annotations=domain))
        assert stage.wait_bound("carried") == "edge-1"
        annotations = stage.pod("carried")["metadata"]["annotations"]
        assert annotations["lab.example/by"] == "courier"
        assert annotations[str(Annotation.GRANTED_DOMAIN)].isdigit()
        stage.create_pod(pod("skipped"))
        assert stage.wait_bound("skipped") == "edge-1"
        assert "lab.example/by" not in stage.pod("skipped")["metadata"].get("annotations", {})
        stage.create_pod(pod("dropped", labels={"courier": "ill"}))
        text = stage.wait_refused("dropped", reason="SchedulerError")
        assert text == 'binding rejected: running Bind plugin "Courier": OSError: the courier is ill'


def test_in_a_profile_of_kube_schedulers_plugins_alone_pods_of_apps_wait_with_the_reason(
    installed_plane: ControlPlane, stage: Stage, start: Callable[..., Process]
) -> None:
    """Nothing there checks the claim of their domain."""
    start(SOURCE, "Docks", plugins=without_ours)
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("member", labels={str(Label.APP_UID): "app-1"}))
        text = stage.wait_refused("member", reason="Unschedulable")
        assert "cannot place pods of a RobotApp" in text
        assert "enable ROSReserve at reserve and ROSBind at bind" in text
        stage.create_pod(pod("bare"))
        assert stage.wait_bound("bare") == "edge-1"


def alive(process: Process) -> bool:
    try:
        with urllib.request.urlopen(f"{process.health_url}/livez", timeout=2, context=unverified()) as answer:  # noqa: S310 - our own
            return bool(answer.status == 200)
    except OSError:
        return False


def test_a_plugin_that_does_not_come_back_for_a_pod_is_broken_off_and_others_are_bound(
    installed_plane: ControlPlane, stage: Stage, start: Callable[..., Process]
) -> None:
    process = start(WAITS, "Waits")
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("waits", labels={"patience": "some"}))
        stage.create_pod(pod("healthy"))
        stage.wait_bound("healthy", timeout_s=120)
        text = stage.wait_refused("waits", reason="SchedulerError")
        assert text == "plugin Waits: filter did not answer within 5 s and was broken off"
        said = f"filter of plugin Waits has not answered for 5 s about pod {stage.namespace}/waits: it is broken off"
        assert said in process.log_text()
        stage.wait(lambda: alive(process), what=process.log_text)
        stage.delete_pod("waits")  # the next scheduler is not to meet it


def test_after_a_plugin_that_cannot_be_broken_off_has_ended_the_process_the_next_one_binds_the_healthy_pods(
    installed_plane: ControlPlane, stage: Stage, start: Callable[..., Process]
) -> None:
    process = start(WAITS, "Waits")
    with nodes(installed_plane, edge("edge-1")):
        stage.wait(lambda: alive(process), what=process.log_text)
        stage.create_pod(pod("waits", labels={"patience": "endless"}))
        stage.wait(lambda: not process.running, what=process.log_text, timeout_s=120)
        said = f"filter of plugin Waits cannot be broken off about pod {stage.namespace}/waits"
        assert said in process.log_text().splitlines()[-1]
        stage.create_pod(pod("healthy"))
        again = start(WAITS, "Waits")
        stage.wait_bound("healthy", timeout_s=120)
        text = stage.wait_refused("waits", reason="SchedulerError")
        assert text.startswith(
            f"plugin Waits: not asked about pods like {stage.namespace}/waits any more, because filter could not be broken off"
        )
        stage.create_pod(pod("later"))
        stage.wait_bound("later")
        stage.wait(lambda: alive(again), what=again.log_text)
        stage.delete_pod("waits")


def test_after_two_deaths_in_the_same_question_to_a_plugin_it_is_not_asked_again_and_healthy_pods_are_bound(
    installed_plane: ControlPlane, stage: Stage, start: Callable[..., Process]
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("deadly", labels={"deadly": "yes"}))
        for _ in range(2):
            process = start(DIES, "Dies", wait=False)
            stage.wait(lambda: not process.running, what=process.log_text, timeout_s=120)  # noqa: B023 - of this round
        stage.create_pod(pod("healthy"))
        again = start(DIES, "Dies")
        stage.wait_bound("healthy", timeout_s=120)
        text = stage.wait_refused("deadly", reason="SchedulerError")
        assert "the process died 2 times while filter was asked" in text
        stage.wait(lambda: alive(again), what=again.log_text)
        stage.delete_pod("deadly")
