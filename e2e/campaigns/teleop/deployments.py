"""Makes one deployment on the site: applies the RobotApp, waits for its window, reads its figures and deletes it."""

import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from campaigns.teleop import apps, metrics
from campaigns.teleop.cluster import PLACE, Site
from campaigns.teleop.design import Turn
from campaigns.teleop.machine import CpuTimes
from campaigns.teleop.metrics import Command
from campaigns.teleop.records import Deployment, Load
from robotapp_api.model.names import Label
from robotapp_testbed import wait_until
from robotapp_testbed.failures import ApiStatusError, TestbedError

_POLL_S: Final = 0.2
_TAIL_S: Final = metrics.LOST_MS / 1000 + 0.2
"""Time after the window in which its last command is answered or given up."""
_GONE_S: Final = 60.0
_CLOCK_MOVED_S: Final = 0.5
_APPS: Final = f"/apis/robotics.io/v1alpha1/namespaces/{PLACE}/robotapps"
_PODS: Final = f"/api/v1/namespaces/{PLACE}/pods"


class Attempt:
    """One deployment while it runs."""

    def __init__(self, site: Site, turn: Turn, *, session: int) -> None:
        self._site = site
        self._turn = turn
        self._session = session
        self._file: Path | None = None
        self._applied_s = 0.0
        self._killed_containers: set[str] = set()

    def run(self) -> Deployment:
        """Returns what became of it; nothing of it is left then."""
        clock_offset_s = time.time() - time.monotonic()
        began_at = datetime.now(UTC).isoformat(timespec="seconds")
        self._applied_s = time.time()
        self._site.cp.api.create(_APPS, apps.make_app(self._turn))
        try:
            load = self._watch_window()
            pods = self._list_pods()
            commands = self._read_commands()
            void = self._site.find_fault()
        finally:
            self._remove()
        if abs(time.time() - time.monotonic() - clock_offset_s) > _CLOCK_MOVED_S:
            void = "the wall clock moved"
        return Deployment(
            turn=self._turn,
            session=self._session,
            began_at=began_at,
            node=find_operator_node(pods),
            helpers=list_helper_nodes(pods),
            restarts=count_restarts(pods),
            figures=metrics.measure(commands, applied_s=self._applied_s),
            load=load,
            trips_ms=list_trips(commands),
            void=void,
        )

    def _watch_window(self) -> Load | None:
        """Waits until the window and its last answers are over, or no round trip came in time."""
        window: tuple[float, float] | None = None

        def has_window() -> bool:
            nonlocal window
            window = metrics.find_window(self._read_commands())
            return window is not None

        if not wait_until(has_window, timeout_s=metrics.NO_TRIP_S, poll_s=_POLL_S) or window is None:
            return None
        begin_s, end_s = window
        _sleep_until(begin_s)
        before = CpuTimes.read()
        _sleep_until(end_s)
        load = before.describe_load(CpuTimes.read(), average=os.getloadavg()[0])
        _sleep_until(end_s + _TAIL_S)
        return load

    def _read_commands(self) -> list[Command]:
        """Reads the program's file from the node's disk, without a process in the pod that would slow it down."""
        if self._file is None or not self._file.exists():
            operator = find_operator(self._list_pods())
            if operator is None or not operator["spec"].get("nodeName"):
                return []
            node = self._site.cp.node(operator["spec"]["nodeName"])
            self._file = node.empty_dir(operator["metadata"]["uid"], apps.RESULTS) / apps.FILE
        return metrics.read_commands(self._file.read_text()) if self._file.exists() else []

    def _list_pods(self) -> list[dict[str, Any]]:
        selector = f"{Label.APP.value}={apps.make_name(self._turn)}"
        pods: list[dict[str, Any]] = self._site.cp.api.get(f"{_PODS}?labelSelector={selector}")["items"]
        return sorted(pods, key=lambda pod: str(pod["metadata"]["creationTimestamp"]))

    def _remove(self) -> None:
        """Deletes the app and waits until none of its pods is left."""
        try:
            self._site.cp.api.delete(f"{_APPS}/{apps.make_name(self._turn)}")
        except ApiStatusError as error:
            if error.status != 404:
                raise

        def are_gone() -> bool:
            pods = self._list_pods()
            for pod in pods:
                self._kill_containers(pod)
            return not pods

        if not wait_until(are_gone, timeout_s=_GONE_S, poll_s=_POLL_S):
            raise TestbedError(f"pods of {apps.make_name(self._turn)} are still there after {_GONE_S:g} s")

    def _kill_containers(self, pod: Mapping[str, Any]) -> None:
        """Ends what runs in a pod that is being deleted: a discovery server runs on for all of its 30 s of grace."""
        node = pod["spec"].get("nodeName")
        if "deletionTimestamp" not in pod["metadata"] or not node:
            return
        for status in pod["status"].get("containerStatuses", ()):
            container_id = status.get("containerID", "")
            if container_id and container_id not in self._killed_containers:
                self._killed_containers.add(container_id)
                with suppress(TestbedError):  # ended meanwhile
                    self._site.cp.node(node).kill_container(container_id)


def find_operator(pods: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Returns the newest pod of the operator side; pods come oldest first."""
    operators = [pod for pod in pods if pod["metadata"]["labels"].get(Label.COMPONENT.value) == apps.OPERATOR]
    return operators[-1] if operators else None


def find_operator_node(pods: Sequence[dict[str, Any]]) -> str:
    operator = find_operator(pods)
    return str(operator["spec"].get("nodeName", "")) if operator else ""


def list_helper_nodes(pods: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Returns the nodes of the pods that are no components: discovery servers or master."""
    return {
        pod["metadata"]["name"]: pod["spec"].get("nodeName", "")
        for pod in pods
        if Label.COMPONENT.value not in pod["metadata"]["labels"]
    }


def count_restarts(pods: Sequence[dict[str, Any]]) -> int:
    statuses = (status for pod in pods for status in pod.get("status", {}).get("containerStatuses", ()))
    return sum(status["restartCount"] for status in statuses)


def list_trips(commands: Sequence[Command]) -> tuple[float | None, ...]:
    """Returns the round trips of the window, None for a lost command."""
    window = metrics.find_window(commands)
    if window is None:
        return ()
    begin_s, end_s = window
    return tuple(
        None if command.rtt_ms is None else round(command.rtt_ms, 3)
        for command in commands
        if begin_s <= command.sent_s < end_s
    )


def _sleep_until(wall_s: float) -> None:
    time.sleep(max(wall_s - time.time(), 0))
