"""The four real nodes of the protocol with our programs, and the conditions they are put into."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from campaigns.nodes import real_pods
from campaigns.teleop.apps import IMAGES
from campaigns.teleop.design import CLOUD, FAR, LINK_AS_SET, NEAR, ROBOT, RTT_MS, WORSE_LINK, Condition
from robotapp_testbed import images
from robotapp_testbed.control_plane import components_as_pods, product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines.nodes import cloud, edge, robot
from robotapp_testbed.real import RealNodes

NODES: Final = (robot(ROBOT), edge(NEAR), edge(FAR, zone="hall-2"), cloud(CLOUD))
PLACE: Final = "eo2"
CORES: Final = 1.0
"""CPU that the pods of a node may use together."""
INTERVAL_S: Final = 2
SETTLE_S: Final = 8.0
"""Time between a change of the condition and the next deployment."""
_RESIDENTS_PLACE: Final = "residents"
_SWITCH, _BURN = "switch", "burn"
# Two such loops on two cores use up the quota of one core. It sleeps long: each sleep is a process of its own.
_LOOP: Final = f"while :; do if [ -e /{_SWITCH}/{_BURN} ]; then i=0; while [ $i -lt 50000 ]; do i=$((i+1)); done; else sleep 1; fi; done"


class Site:
    """A running cluster; made by `run_site`."""

    def __init__(self, cp: RealNodes) -> None:
        self.cp = cp
        self._condition: Condition | None = None
        self._switch_folder: Path | None = None
        self._programs: frozenset[str] = frozenset()

    def prepare(self) -> None:
        """Limits the nodes' CPU and lets the residents move in."""
        for node in self.cp.nodes.values():
            node.limit_pods_cpu(CORES)
        residents = [make_resident(node) for node in (NEAR, FAR, CLOUD)]
        real_pods.run(self.cp, _RESIDENTS_PLACE, *residents)
        near_uid = real_pods.get(self.cp, _RESIDENTS_PLACE, _make_name(NEAR))["metadata"]["uid"]
        self._switch_folder = self.cp.node(NEAR).empty_dir(near_uid, _SWITCH)
        if not self._switch_folder.is_dir():
            raise TestbedError(f"the volume of the resident on {NEAR} is not at {self._switch_folder}")
        components_as_pods.wait_measured(self.cp)
        self._programs = frozenset(self.cp.pids())

    def set_condition(self, condition: Condition) -> None:
        """Brings the site into a condition, and waits until whoever measures has measured it."""
        before, self._condition = self._condition, condition
        if before and (before.ballast, before.worse_link) == (condition.ballast, condition.worse_link):
            return
        self.cp.switch.set_link(ROBOT, NEAR, **(WORSE_LINK if condition.worse_link else LINK_AS_SET))
        if self._switch_folder is None:
            raise TestbedError("the site has no residents yet: prepare it first")
        marker = self._switch_folder / _BURN
        if condition.ballast:
            marker.touch()
        else:
            marker.unlink(missing_ok=True)
        time.sleep(SETTLE_S)

    def find_fault(self) -> str:
        """Returns what of the site itself is broken, "" when all is well."""
        if missing_programs := self._programs - set(self.cp.pids()):
            return f"{', '.join(sorted(missing_programs))} ended"
        if absent := self.cp.nodes.keys() - self.cp.ready_nodes():
            return f"{', '.join(sorted(absent))} not Ready"
        return ""


@contextmanager
def run_site() -> Iterator[Site]:
    """Starts nodes, agents, operator and scheduler; everything ends with the block."""
    delays = {pair: rtt_ms / 2 for pair, rtt_ms in RTT_MS.items()}
    with RealNodes(NODES, delays=delays, images=("tools", "agent", *IMAGES)) as cp:
        components_as_pods.start_agents(cp, interval_s=INTERVAL_S)
        product.start_operator(cp)
        product.start_scheduler(cp)
        with created(cp, _RESIDENTS_PLACE), created(cp, PLACE):
            site = Site(cp)
            site.prepare()
            yield site


def make_resident(node: str) -> dict[str, Any]:
    """Returns a pod without requests that burns CPU while a file is in its volume, and looks the same otherwise."""
    line = f"({_LOOP}) & {_LOOP}"
    mount = {"name": _SWITCH, "mountPath": f"/{_SWITCH}"}
    return real_pods.pod(
        _make_name(node),
        node,
        ("sh", "-c", line),
        container={"image": images.reference("tools"), "volumeMounts": [mount]},
        volumes=[{"name": _SWITCH, "emptyDir": {}}],
    )


def _make_name(node: str) -> str:
    return f"resident-{node}"
