"""One application on real nodes: its pods, what they print and when, the faults, and waiting for what it promises."""

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from typing import Any, Final

from tests.support.work_unit import slowness

from campaigns.nodes import teleop_app
from campaigns.reference.catalogue import Scenario
from campaigns.reference.robotapps import make_volume, read_app, read_claims
from robotapp_api.model.names import API_VERSION, Label
from robotapp_testbed import wait_until
from robotapp_testbed.real import RealNodes

Json = dict[str, Any]
STARTED_S: Final = 90.0
REPLACED_S: Final = 30.0
POLL_S: Final = 0.3
LAST_WORDS: Final = 600
"""Characters of a log in the text of a broken promise."""
_LINE: Final = re.compile(r"(\S+Z) (.*)")


class BrokenPromiseError(Exception):
    """Raised when an application does not do something in time; the text has what it printed last."""


class RunningApp:
    """An application of the folder `name`, on a cluster of real nodes. Limits of time are multiplied by how slow the machine is at that moment."""

    def __init__(self, cp: RealNodes, namespace: str, scenario: Scenario, name: str, *, scheduler: str) -> None:
        self.cp = cp
        self.namespace = namespace
        self.scenario = scenario
        self.name = name
        self._scheduler = scheduler
        self.applied_s = 0.0

    def apply(self) -> None:
        """Applies the app, and before it the claim that its page has, with a volume on the scenario's node."""
        claims = read_claims(self.name)
        for claim in claims:
            volume = make_volume(claim, self.namespace, self.scenario.volume_node)
            self.cp.node(self.scenario.volume_node).box.run("/bin/mkdir", "-p", volume["spec"]["local"]["path"])
            teleop_app.apply(self.cp, self.namespace, [volume, claim])
        self.applied_s = time.time()
        app = read_app(self.name, self.scenario.runs_on, scheduler=self._scheduler)
        teleop_app.apply(self.cp, self.namespace, [app])

    # --- what is there ----------------------------------------------------------------------------------------

    def list_pods(self) -> dict[str, Json]:
        """Returns the newest pod of each component."""
        return teleop_app.pods(self.cp, self.namespace, self.name)

    def list_nodes(self) -> dict[str, str]:
        """Returns the node of each component, "" for one that waits."""
        return {component: pod["spec"].get("nodeName", "") for component, pod in self.list_pods().items()}

    def node_of(self, component: str) -> str:
        return self.list_nodes().get(component, "")

    def uid_of(self, component: str) -> str:
        """Returns the uid of the component's newest pod, "" without one."""
        pod = self.list_pods().get(component)
        return str(pod["metadata"]["uid"]) if pod else ""

    def count_restarts(self) -> int:
        """Returns how often containers of the newest pods were started again."""
        statuses = [pod["status"].get("containerStatuses", []) for pod in self.list_pods().values()]
        return sum(status["restartCount"] for pod_statuses in statuses for status in pod_statuses)

    def read_log(self, component: str) -> str:
        """Returns what the component's newest pod has printed, "" without one."""
        return "\n".join(text for _, text in self.list_lines(component))

    def list_lines(self, component: str, *, after_s: float = 0.0) -> list[tuple[float, str]]:
        """Returns the lines of the component's newest pod with the time (of the epoch, in s) at which they were printed.

        All nodes have this machine's clock, so these times compare with `time.time()`.
        """
        pod = self.list_pods().get(component)
        if pod is None:
            return []
        name = pod["metadata"]["name"]
        text = self.cp.kubectl("logs", "--timestamps", "-n", self.namespace, name, "-c", component, check=False)
        matches = filter(None, map(_LINE.fullmatch, text.splitlines()))
        lines = [(read_time(match[1]), match[2]) for match in matches]
        return [(at_s, line) for at_s, line in lines if at_s > after_s]

    def find_time(self, component: str, words: str, *, after_s: float = 0.0) -> float | None:
        """Returns when the component first printed these words after a time, None when it has not."""
        lines = self.list_lines(component, after_s=after_s)
        return next((at_s for at_s, line in lines if words in line), None)

    def read_reason(self, condition: str) -> str:
        """Returns the reason of a condition of the app."""
        path = f"/apis/{API_VERSION}/namespaces/{self.namespace}/robotapps/{self.name}"
        conditions: list[Json] = self.cp.api.get(path).get("status", {}).get("conditions", [])
        return next((str(item["reason"]) for item in conditions if item["type"] == condition), "")

    # --- faults -----------------------------------------------------------------------------------------------

    def kill_pod(self, component: str) -> None:
        """Deletes the component's pod, which has a second to end, and waits until another one is there."""
        pod = self.list_pods()[component]["metadata"]
        self.cp.kubectl("delete", "pod", "-n", self.namespace, pod["name"], "--grace-period=1", "--wait=false")

        def is_replaced() -> bool:
            return self.uid_of(component) not in ("", pod["uid"])

        self.wait_until(is_replaced, what=f"{component} has a new pod", component=component, within_s=REPLACED_S)

    def replace_master(self, components: Sequence[str]) -> None:
        """Deletes the pod of the master of ROS 1, and waits until the operator of RobotApp has started components anew."""
        uids = {component: self.uid_of(component) for component in components}
        selector = f"{Label.APP}={self.name},{Label.ROLE}=master"
        self.cp.kubectl("delete", "pod", "-n", self.namespace, "-l", selector, "--grace-period=1", "--wait=false")

        def are_new() -> bool:
            return all(self.uid_of(component) not in ("", uid) for component, uid in uids.items())

        self.wait_until(
            are_new, what=f"{' and '.join(components)} have new pods", component=components[0], within_s=STARTED_S
        )

    @contextmanager
    def cut_link(self, name: str, other_name: str) -> Iterator[None]:
        """Cuts what the pods of two nodes send each other; the cluster reaches both."""
        self.cp.switch.set_link(name, other_name, down=True)
        try:
            yield
        finally:
            self.cp.switch.set_link(name, other_name, down=False)

    @contextmanager
    def take_offline(self, name: str) -> Iterator[None]:
        """Takes a node offline, for the cluster and for the pods of all other nodes. Its own pods go on."""
        node = self.cp.node(name)
        self.cp.switch.set_node(name, down=True)
        try:
            node.cut_off()
            yield
        finally:
            node.reconnect()
            self.cp.switch.set_node(name, down=False)

    # --- waiting ----------------------------------------------------------------------------------------------

    def wait_until(self, condition: Callable[[], object], *, what: str, component: str, within_s: float) -> None:
        """Waits for a condition; BrokenPromiseError with what the component printed last when it does not come about."""
        allowed_s = within_s * slowness(seconds=0.2)
        if wait_until(lambda: bool(condition()), timeout_s=allowed_s, poll_s=POLL_S):
            return
        log = self.read_log(component)[-LAST_WORDS:]
        status = self.cp.kubectl("get", "robotapp,pods", "-n", self.namespace, "-o", "wide", check=False)
        raise BrokenPromiseError(f"{what}: not within {allowed_s:.0f} s; {component} printed last: {log}\n{status}")

    def wait_for(self, component: str, words: str, *, within_s: float, after_s: float = 0.0) -> float:
        """Waits until the component prints these words, and returns when that was."""

        def is_printed() -> bool:
            return self.find_time(component, words, after_s=after_s) is not None

        self.wait_until(is_printed, what=f"{component} prints {words!r}", component=component, within_s=within_s)
        return self.find_time(component, words, after_s=after_s) or time.time()


def read_time(text: str) -> float:
    """Reads a time of a container's log, which has nanoseconds."""
    whole, _, fraction = text.removesuffix("Z").partition(".")
    return datetime.fromisoformat(f"{whole}+00:00").timestamp() + float(f"0.{fraction or 0}")
