"""All scenarios, in the thesis' order."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from campaigns.scenarios.contenders import BOTH, OURS, Contender
from campaigns.scenarios.promises import devices, domains, hardware, volumes, zones
from campaigns.scenarios.promises.place import Place, Verdict


@dataclass(frozen=True, slots=True)
class Scenario:
    """`section` of the thesis; `counted` is what the verdict counts. `under`: the schedulers that know such objects."""

    name: str
    section: str
    text: str
    counted: str
    run: Callable[[Place], Verdict]
    under: tuple[Contender, ...] = BOTH


_ALL: Final = (
    Scenario("gpu", "4.4.1", "pods that need a GPU, on GPU nodes", "pods", hardware.gpu),
    Scenario("camera", "4.4.1", "a pod on the node with its USB camera; none where no node has it", "pods", hardware.camera),
    Scenario("zone-room", "4.4.2", "replicas in the first preferred zone while it has room", "pods", zones.with_room),
    Scenario("zone-spill", "4.4.2", "first zone filled, then the second, then the rest", "pods", zones.spill),
    Scenario("shared-volume", "4.4.3", "a ReadWriteMany claim keeps its pods from no node", "pods", volumes.shared_by_all),
    Scenario("node-volume", "4.4.3", "a ReadWriteOnce claim keeps its pods on its volume's node", "pods", volumes.of_one_node),
    Scenario("fleet", "4.4.3", "a coordinator at its volume, its robots beside it", "pods", volumes.fleet),
    Scenario("queue", "4.4.3", "a full node goes to realtime, then to pods without a class, then to best_effort", "places", zones.by_class),
    Scenario("domain-auto", "4.4.4", "pods with `auto` on one node have different domains, with a claim each", "pods", domains.automatic),
    Scenario("domain-taken", "4.4.4", "a taken domain: the second pod waits, names the holder, gets it afterwards", "promises", domains.taken),
    Scenario("bus-pods", "4.4.4", "two pods for can0: the second waits, names the holder, runs ≤ 2 s after the release", "promises", devices.two_pods),
    Scenario("bus-apps", "4.4.4", "the same with two RobotApps", "promises", devices.two_apps, under=(OURS,)),
    Scenario("failed-bind", "4.4.4", "a bind that fails leaves no claim when its pod is gone", "promises", devices.failed_binding, under=(OURS,)),
    Scenario("shutdown", "3.4.4", "pods keep away from nodes in graceful shutdown", "pods", zones.shutting_down),
)  # fmt: skip
SCENARIOS: Final = {each.name: each for each in _ALL}
