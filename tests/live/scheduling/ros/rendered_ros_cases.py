"""One wish for each ROS plugin as a user writes it into a RobotApp, and a pair of nodes on which only that plugin sees it.

Of the pair of a plugin one node is the `lure`: it is eight times as large, so every other rule prefers it. The plugin leads to
the other one, `there`. So without the plugin the same app ends on the lure.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from tests.support.apiobjects import component

from campaigns.rigs.stage import pod
from robotapp_api.model.names import API_VERSION, SCHEDULER_NAME, Label
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import Device, SimulatedNode, edge, robot

Json = dict[str, Any]

ROBOT: Final = "amr-07"
POOL: Final = "rendered"
BUS: Final = Device("can-can0", "can", interface="can0")
GPU: Final = Device("gpu-0", "gpu", model="nvidia")
PAIR: Final = "test/pair"
REQUESTS: Final = {"cpu": "1", "memory": "2Gi"}
PLANNER: Final = "planner"
NEAR_MS, FAR_MS = 5.0, 60.0
NEAR, EMPTY = "objective-near", "objective-empty"


@dataclass(frozen=True, slots=True)
class Wish:
    """What an app states for the sake of one plugin.

    `rtt_ms`: between the robot and (there, the lure). `planner`: fields of the component in question; it is one of `others`.
    """

    planner: Mapping[str, Any] = field(default_factory=dict)
    spec: Mapping[str, Any] = field(default_factory=dict)
    others: tuple[Json, ...] = ()
    rtt_ms: tuple[float, float] | None = None
    devices: tuple[Device, ...] = ()
    """Of `there`."""


def there(plugin: str) -> str:
    return f"{plugin.lower()}-there"


def lure(plugin: str) -> str:
    return f"{plugin.lower()}-lure"


def _to_robot(**latency: Any) -> Json:
    found: Json = {"topic": "/scan", "from": "@robot", "to": PLANNER}
    return {"edges": [{**found, "latency": latency} if latency else found]}


def _zones(plugin: str) -> Json:
    return {"placement": {"zones": [there(plugin)]}}


def _at(plugin: str) -> Json:
    """A template that leaves a component no node but `there`."""
    return {"spec": {"nodeSelector": {str(Label.HOSTNAME): there(plugin)}}}


WISHES: Final[Mapping[str, Wish]] = {
    # The budget leaves next to nothing to LatencyScore: it is the refusal that decides.
    "LatencyFilter": Wish(spec=_to_robot(budget="30ms"), rtt_ms=(29.5, 31.0)),
    "HardwareAffinityFilter": Wish(planner={"requires": [{"type": "gpu", "model": "nvidia"}]}, devices=(GPU,)),
    "SharedDataFilter": Wish(
        planner={"colocateWith": ["camera"]}, others=(component("camera", template=_at("SharedDataFilter")),)
    ),
    "TopologyScore": Wish(spec=_zones("TopologyScore")),
    "LatencyScore": Wish(spec=_to_robot(budget="100ms"), rtt_ms=(NEAR_MS, FAR_MS)),
    "LoadBalanceScore": Wish(planner={"qosClass": "realtime"}),
    "DeadlineScore": Wish(planner={"policies": {"deadline": "100ms"}}, spec=_to_robot(), rtt_ms=(NEAR_MS, FAR_MS)),
}
"""Plugins that choose a node."""
LOADS: Final = {
    there("LoadBalanceScore"): {"cpu": "1600m", "memory": "57Gi"},
    lure("LoadBalanceScore"): {"cpu": "7200m", "memory": "22Gi"},
    NEAR: {"cpu": "8", "memory": "32Gi"},
}
"""What other pods request of 16 processors and 64 GiB: of both together the second has more left, of processors the first."""
OBJECTIVES: Final = {"Latency": NEAR, "Balance": EMPTY}
"""Where an app goes by what it is to be placed for: `near` is half full, the empty node is still within the budget."""
QUEUE, RESERVE, BIND = "ROSQueueSort", "ROSReserve", "ROSBind"
PLUGINS: Final = (*WISHES, QUEUE, RESERVE, BIND)
FIRST, URGENT = "queue-a-first", "queue-b-urgent"


def world() -> Topology:
    """A robot that its taint keeps free, a pair of nodes for each wish, and one node for which two apps queue."""
    taint = {"key": str(Label.ROBOT), "value": ROBOT, "effect": "NoSchedule"}
    nodes: list[SimulatedNode] = [robot(ROBOT, zone="floor", devices=[BUS], taints=[taint])]
    for plugin, wish in WISHES.items():
        equal = plugin == "LoadBalanceScore"
        small, large = ("16", "64Gi") if equal else ("8", "32Gi"), ("16", "64Gi") if equal else ("64", "256Gi")
        for name, (cpu, memory), devices in ((there(plugin), small, wish.devices), (lure(plugin), large, ())):
            nodes.append(edge(name, zone=name, cpu=cpu, memory=memory, devices=devices, labels={PAIR: plugin}))
    nodes.append(edge(there(QUEUE), zone=there(QUEUE), cpu="8", labels={PAIR: QUEUE}))
    nodes += [edge(name, zone=name, labels={PAIR: "objective"}) for name in (NEAR, EMPTY)]
    found = Topology(nodes, rtt_ms={(ROBOT, NEAR): NEAR_MS, (ROBOT, EMPTY): FAR_MS})
    for plugin, wish in WISHES.items():
        for name, rtt_ms in zip((there(plugin), lure(plugin)), wish.rtt_ms or (), strict=False):
            found.set_rtt(ROBOT, name, rtt_ms)
    return found


def loads() -> list[Json]:
    """Pods of other people that are there already."""
    return [pod(f"load-{node}", nodeName=node, requests=requests) for node, requests in LOADS.items()]


def app(name: str, planner: Json, *others: Json, **spec: Any) -> Json:
    """A RobotApp for the robot."""
    wanted = {"nodeSelector": {"matchLabels": {str(Label.ROBOT): ROBOT}}}
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": name},
        "spec": {
            "ros": {"distro": "humble"},
            "ros2": {"pool": POOL, "discovery": {"mode": "Multicast"}},
            "robots": wanted,
            "components": [planner, *others],
            **spec,
        },
    }


def planner(pair: str, *, cpu: str = REQUESTS["cpu"], **fields: Any) -> Json:
    """The component in question, for one pair of nodes."""
    template = {"spec": {"nodeSelector": {PAIR: pair}}}
    return component(PLANNER, resources={"requests": {**REQUESTS, "cpu": cpu}}, template=template, **fields)


def apps_of(plugin: str, *, mark: str = "") -> list[Json]:
    """The apps in which a plugin acts, in the order of their creation; `mark` begins their names."""
    name = mark + plugin.lower()
    if plugin in WISHES:
        wish = WISHES[plugin]
        return [app(name, planner(plugin, **wish.planner), *wish.others, **wish.spec)]
    if plugin == QUEUE:  # the node has room for one; the one that matters less has the earlier name, too
        kinds = {FIRST: "best_effort", URGENT: "realtime"}
        return [app(mark + each, planner(QUEUE, cpu="5", qosClass=kind)) for each, kind in kinds.items()]
    bus = {"devices": [{"name": "bus", "type": BUS.type, "interface": BUS.interface}]} if plugin == RESERVE else {}
    return [app(name, component(PLANNER, runsOn=["Robot"], **bus))]


def for_objective(name: str) -> Json:
    edges = _to_robot(budget="100ms")
    return app(f"objective-{name.lower()}", planner("objective"), placement={"objective": name}, **edges)


def outcomes(plugin: str) -> tuple[str, str]:
    """What is seen of an app with the plugin, and without it."""
    if plugin in WISHES:
        return there(plugin), lure(plugin)
    return {
        QUEUE: (URGENT, FIRST),
        RESERVE: (f"granted {BUS.id}", "enable ROSReserve at reserve and ROSReserve at postBind"),
        BIND: ("bound", "enable ROSBind at bind"),
    }[plugin]


def document(*without: str) -> Json:
    """The shipped configuration, but for the plugins that are left out. Where there must be one, it is kube-scheduler's own."""
    stand_ins = {QUEUE: "PrioritySort", BIND: "DefaultBinder"}
    changed = {
        "disabled": [{"name": name} for name in without],
        "enabled": [{"name": stand_ins[name]} for name in without if name in stand_ins],
    }
    profile = {"schedulerName": SCHEDULER_NAME, "plugins": {"multiPoint": changed}}
    return {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaderElect": False},
        "profiles": [profile],
    }
