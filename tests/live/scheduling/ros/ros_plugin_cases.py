"""The ten ROS plugins on a live control plane: one small world, and what each plugin does there to apps and to bare pods.

All cases share the nodes of WORLD and one scheduler, which has a profile for each set of arguments. A case says the same
wish in both words, the annotations of a pod and the fields of a RobotApp, and where the pod goes or why not.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from tests.support.apiobjects import component

from campaigns.rigs.stage import Json, Stage, deployment, pod
from campaigns.rigs.storage_live import VOLUMES, claim, claims_path, delete_volume, volume
from robotapp_api.model.names import API_VERSION, SCHEDULER_NAME, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import Device, edge, robot

APP, POD = "app", "pod"
KINDS: Final = (APP, POD)
TELEMETRY: Final = f"/apis/{API_VERSION}/nodetelemetries"

END, NEAR, MID, FAR, DARK, CLOSING = "end", "near", "mid", "far", "dark", "closing"
CAN: Final = Device("can-can0", "can", interface="can0")
GPU: Final = Device("gpu-0", "gpu", model="nvidia")
WORLD: Final = (
    robot(END, zone="floor", taints=[{"key": "only", "value": "robots", "effect": "NoSchedule"}]),
    edge(NEAR, zone="zone-1", devices=[GPU]),
    edge(MID, zone="zone-2"),
    edge(FAR, zone="zone-3", devices=[CAN]),
    edge(DARK, zone="zone-4"),
    edge(CLOSING, zone="zone-1", annotations={"scheduler.robotics.io/graceful-shutdown": "true"}),
)
"""Pods of the cases go anywhere but to the robot, which is the other end of their budgets."""
RTT_MS: Final = {NEAR: (5, 5), MID: (20, 20), FAR: (8, 60), CLOSING: (1, 1)}
"""From the robot: p50, p95. Of the dark node nothing is known, nor of its zone."""
LOAD: Final = {NEAR: ("9600m", "6Gi"), MID: ("1600m", "45Gi")}
"""What pods on these nodes request, of 16 processors and 64 GiB: the one is short of processors, the other of memory."""

BUDGET, DEADLINE = "30ms", "100ms"


def _only(plugin: str, **args: Any) -> Json:
    """A profile that scores by one plugin."""
    score = {"disabled": [{"name": "*"}], "enabled": [{"name": plugin, "weight": 1}]}
    return {"plugins": {"score": score}, "pluginConfig": [{"name": plugin, "args": args}] if args else []}


def _latency(**args: Any) -> Json:
    return {"pluginConfig": [{"name": "LatencyFilter", "args": args}]}


PROFILES: Final[Mapping[str, Json]] = {
    SCHEDULER_NAME: {},
    "tight": _latency(maxLatency="10ms"),
    "deny": _latency(unknown="Deny"),
    "outlier": _latency(outlierFactor=4),
    "topology": _only("TopologyScore"),
    "latency": _only("LatencyScore"),
    "min-max": _only("LatencyScore", normalize="MinMax"),
    "load": _only("LoadBalanceScore"),
    "deadline": _only("DeadlineScore"),
}


def document(profiles: Mapping[str, Json] = PROFILES) -> Json:
    """The configuration with these profiles, for a scheduler that is not alone."""
    return {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaderElect": False},
        "profiles": [{"schedulerName": name, **profile} for name, profile in profiles.items()],
    }


@dataclass(frozen=True, slots=True)
class Case:
    """`annotations` of a pod and `component` and `spec` of an app are the same wish; one of them may be absent.

    `among`: the only nodes the pod may use, if any are named. It goes to `node`, or waits with words of `refused`.
    """

    plugin: str
    situation: str
    annotations: Mapping[str, Any] | None = None
    component: Mapping[str, Any] | None = None
    spec: Mapping[str, Any] = field(default_factory=dict)
    profile: str = SCHEDULER_NAME
    labels: Mapping[str, str] = field(default_factory=dict)
    instance: str = END
    among: Sequence[str] = ()
    node: str = ""
    refused: str = ""

    @property
    def kinds(self) -> tuple[str, ...]:
        """As what it is played."""
        wishes = {APP: self.component, POD: self.annotations}
        return tuple(kind for kind in KINDS if wishes[kind] is not None)

    def name(self, kind: str) -> str:
        return f"{self.plugin}: {self.situation} ({kind})"


def topic(**latency: Any) -> Json:
    """A connection of an app's planner to its robot; without a budget it is held to maxLatency."""
    found: Json = {"topic": "/scan", "from": "@robot", "to": "planner"}
    return {"edges": [{**found, "latency": latency} if latency else found]}


_TO_END: Final = {"topology": {"master_node": END}}
_BUDGET: Final = {"policies": {"latency_budget": BUDGET}, **_TO_END}
_EDGE: Final = topic(budget=BUDGET)
_NOTHING: Final[Json] = {}


def _filter(situation: str, **fields: Any) -> Case:
    return Case("LatencyFilter", situation, **fields)


LATENCY_FILTER: Final = (
    _filter("within the budget", annotations=_BUDGET, component={}, spec=_EDGE, among=[MID], node=MID),
    _filter("beyond the budget", annotations=_BUDGET, component={}, spec=_EDGE, among=[FAR], refused="exceeded the latency budget"),
    _filter("a node in graceful shutdown", annotations=_BUDGET, component={}, spec=_EDGE, among=[CLOSING], refused="shutting down gracefully"),
    _filter("graceful shutdown without a budget", annotations={"policies": {"qos_class": "realtime"}}, component={}, among=[CLOSING], refused="shutting down gracefully"),
    _filter("maxLatency without a budget", annotations=_TO_END, component={}, spec=topic(), profile="tight", among=[MID], refused="exceeded the latency budget"),
    _filter("maxLatency, near enough", annotations=_TO_END, component={}, spec=topic(), profile="tight", among=[NEAR], node=NEAR),
    _filter("an unknown distance is allowed", annotations=_BUDGET, component={}, spec=_EDGE, among=[DARK], node=DARK),
    _filter("an unknown distance is denied", annotations=_BUDGET, component={}, spec=_EDGE, profile="deny", among=[DARK], refused="had no latency measurement"),
    _filter("a known distance, unknown ones denied", annotations=_BUDGET, component={}, spec=_EDGE, profile="deny", among=[MID], node=MID),
    _filter("an unknown other end is allowed", annotations={"policies": {"latency_budget": BUDGET}}, component={"policies": {"latencyBudget": BUDGET}}, instance="", among=[MID], node=MID),
    _filter("an unknown other end is denied", annotations={"policies": {"latency_budget": BUDGET}}, component={"policies": {"latencyBudget": BUDGET}}, instance="", profile="deny", among=[MID], refused="other end of the latency budget: it is not known"),
    _filter("the robot of the pod's label, unknown ones denied", annotations={"policies": {"latency_budget": BUDGET}}, labels={str(Label.ROBOT): END}, component={"policies": {"latencyBudget": BUDGET}}, profile="deny", among=[MID], node=MID),
    _filter("an outlier", annotations=_TO_END, component={}, spec=topic(), profile="outlier", among=[FAR], refused="were latency outliers"),
    _filter("no outlier", annotations=_TO_END, component={}, spec=topic(), profile="outlier", among=[MID], node=MID),
)  # fmt: skip


def _needs(**hardware: str) -> dict[str, Any]:
    return {"annotations": {"affinity": {"hardware_requirements": [hardware]}}, "component": {"requires": [hardware]}}


def _hardware(situation: str, **fields: Any) -> Case:
    return Case("HardwareAffinityFilter", situation, **fields)


HARDWARE: Final = (
    _hardware("by type", **_needs(type="gpu"), node=NEAR),
    _hardware("by type and model", **_needs(type="gpu", model="nvidia"), node=NEAR),
    _hardware("another model", **_needs(type="gpu", model="amd"), refused="didn't have the required hardware"),
    _hardware("by type and interface", **_needs(type="can", interface="can1"), refused="didn't have the required hardware"),
    _hardware("of another node", **_needs(type="gpu"), among=[MID], refused="didn't have the required hardware"),
)  # fmt: skip


def _beside(claim: str = "", *, peer: str = "") -> dict[str, Any]:
    shared = {"peer_pods": [peer] if peer else [], "pvc": [claim] if claim else []}
    own = {"peerPods": shared["peer_pods"], "claimNames": shared["pvc"]}
    return {"annotations": {"shared-data": shared}, "component": {"sharedData": own}}


def _shared(situation: str, **fields: Any) -> Case:
    return Case("SharedDataFilter", situation, **fields)


PEER, USER = "mapper", "reader"
LOCAL, IN_USE, OF_MANY, NOBODYS = "local", "in-use", "of-many", "nobodys"
SHARED_DATA: Final = (
    _shared("beside a placed peer", **_beside(peer=PEER), node=MID),
    _shared("not elsewhere", **_beside(peer=PEER), among=[NEAR], refused="must share its node with"),
    _shared("a peer that is not placed", **_beside(peer="nobody"), among=[NEAR], node=NEAR),
    _shared("a claim whose volume one node has", **_beside(LOCAL), node=FAR),
    _shared("that claim elsewhere", **_beside(LOCAL), among=[NEAR], refused="couldn't use the volume of a claim"),
    _shared("a claim that a pod uses", **_beside(IN_USE), node=NEAR),
    _shared("a claim for many nodes", **_beside(OF_MANY), among=[DARK], node=DARK),
    _shared("a claim without a volume", **_beside(NOBODYS), among=[DARK], node=DARK),
    _shared("a claim that does not exist", **_beside("gone"), refused='persistentvolumeclaim "gone" not found'),
)


def _score(plugin: str, situation: str, **fields: Any) -> Case:
    return Case(plugin, situation, **fields)


def _zones(*zones: str, master: str = "") -> dict[str, Any]:
    where = {"topology": {"master_node": master, "preferred_zones": zones}}
    return {"annotations": where, "component": {}, "spec": {"placement": {"zones": zones, "masterNode": master}}}


def _class(name: str) -> dict[str, Any]:
    return {"annotations": {"policies": {"qos_class": name}}, "component": {"qosClass": name}}


_LATE: Final = {"policies": {"latency_budget": DEADLINE, "deadline": DEADLINE}, **_TO_END}
_LATE_APP: Final = {"component": {"policies": {"deadline": DEADLINE}}, "spec": topic(budget=DEADLINE)}
SCORES: Final = (
    _score("TopologyScore", "zones in their order", **_zones("zone-3", "zone-2"), profile="topology", node=FAR),
    _score("TopologyScore", "the next zone", **_zones("nowhere", "zone-2"), profile="topology", node=MID),
    _score("TopologyScore", "the master's node first", **_zones("zone-3", master=DARK), profile="topology", node=DARK),
    _score("TopologyScore", "under the shipped weights", **_zones("zone-4", "zone-2"), node=DARK),
    _score("LatencyScore", "most of the budget left", annotations=_BUDGET, component={}, spec=_EDGE, profile="latency", node=NEAR),
    _score("LatencyScore", "unknown is neutral", annotations=_BUDGET, component={}, spec=_EDGE, profile="latency", among=[MID, DARK], node=DARK),
    _score("LatencyScore", "MinMax: unknown is the slowest", annotations=_BUDGET, component={}, spec=_EDGE, profile="min-max", among=[MID, DARK], node=MID),
    _score("LatencyScore", "MinMax: the nearest", annotations=_BUDGET, component={}, spec=_EDGE, profile="min-max", node=NEAR),
    _score("LatencyScore", "by the edge's percentile", component={}, spec=topic(budget=DEADLINE, percentile=50), profile="latency", among=[MID, FAR], node=FAR),
    _score("LoadBalanceScore", "realtime, where processors are free", **_class("realtime"), profile="load", among=[NEAR, MID], node=MID),
    _score("LoadBalanceScore", "best effort, where memory is free, too", **_class("best_effort"), profile="load", among=[NEAR, MID], node=NEAR),
    _score("LoadBalanceScore", "an empty node", **_class("sensor_data"), profile="load", among=[NEAR, MID, DARK], node=DARK),
    _score("DeadlineScore", "most of the deadline left", annotations=_LATE, **_LATE_APP, profile="deadline", among=[NEAR, MID, FAR], node=NEAR),
    _score("DeadlineScore", "by the 95th percentile", annotations=_LATE, **_LATE_APP, profile="deadline", among=[MID, FAR], node=MID),
)  # fmt: skip

CASES: Final = (*LATENCY_FILTER, *HARDWARE, *SHARED_DATA, *SCORES)
PLAYED: Final = [(case, kind) for case in CASES for kind in case.kinds]


class MeasuredStage:
    """The nodes' measurements, loads and volumes, and a way to start either kind of pod."""

    def __init__(self, cp: ControlPlane, namespace: str) -> None:
        self.stage = Stage(cp, namespace)
        self.cp = cp
        self._volumes: list[str] = []
        self._number = 0

    def furnish(self) -> None:
        """Everything the cases count on besides the nodes."""
        self._measure()
        for node, (cpu, memory) in LOAD.items():
            self.stage.create_pod(pod(f"load-{node}", nodeName=node, requests={"cpu": cpu, "memory": memory}))
        self.stage.create_pod(pod(PEER, nodeName=MID))
        self._claim(LOCAL, node=FAR)
        self._claim(IN_USE)
        self._claim(OF_MANY, mode="ReadWriteMany")
        self.cp.api.create(claims_path(self.stage.namespace), claim(NOBODYS, ""))
        mount = [{"name": "data", "persistentVolumeClaim": {"claimName": IN_USE}}]
        self.stage.create_pod(pod(USER, nodeName=NEAR, volumes=mount))

    def clear(self) -> None:
        """What the namespace does not take along."""
        self.cp.api.delete(f"{TELEMETRY}/{END}")
        for name in self._volumes:
            delete_volume(self.cp, name)

    def start(self, case: Case, kind: str) -> str:
        """The name of the case's pod."""
        self._number += 1
        name = f"case-{self._number}"
        fields = {"schedulerName": case.profile, **among(case.among)}
        if kind == POD:
            return self.annotated(name, case.annotations or {}, labels=case.labels, **fields)
        return self.member(name, case.component or {}, instance=case.instance, spec=case.spec, **fields)

    def annotated(self, name: str, annotations: Mapping[str, Any], *, labels: Mapping[str, str] | None = None,
                  **fields: Any) -> str:  # fmt: skip
        """A bare pod; annotations by the last part of their keys, values as JSON unless they are text."""
        texts = {
            f"scheduler.robotics.io/{key}": value if isinstance(value, str) else json.dumps(value)
            for key, value in annotations.items()
        }
        scheduler = fields.pop("schedulerName", SCHEDULER_NAME)
        body = pod(name, scheduler=scheduler, annotations=texts, labels=labels, **fields)
        self.stage.create_pod(body)
        return name

    def member(self, name: str, fields: Mapping[str, Any], *, instance: str = END, spec: Mapping[str, Any] | None = None,
               **pod_spec: Any) -> str:  # fmt: skip
        """The pod of an app with the component `planner`."""
        own = {"robots": {"nodeSelector": {"matchLabels": {str(Label.ROBOT): instance}}}} if instance else {}
        app = self.stage.create_app(name, [component("planner", **fields)], **own, **(spec or {}))
        self.stage.create_deployment(deployment(app, "planner", instance=instance, **pod_spec))
        found = self.stage.wait(
            lambda: self.stage.pods(**{str(Label.APP): name}), what=lambda: f"the Deployment of {name} made no pod"
        )
        return str(found[0]["metadata"]["name"])

    def _measure(self) -> None:
        rtt = [
            {"peer": peer, "p50Us": 1000 * p50, "p95Us": 1000 * p95, "seq": 1, "everyRounds": 1}
            for peer, (p50, p95) in RTT_MS.items()
        ]
        report = {"apiVersion": API_VERSION, "kind": "NodeTelemetry", "metadata": {"name": END}}
        self.cp.api.create(TELEMETRY, report)
        status = {"intervalSeconds": 1000, "seq": 1, "rtt": rtt}
        self.cp.api.patch(f"{TELEMETRY}/{END}/status", {"status": status})

    def _claim(self, name: str, *, mode: str = "ReadWriteOnce", node: str = "") -> None:
        """A claim that is bound to a volume of its own."""
        full = f"{self.stage.namespace}-{name}"
        body = volume(full, "", node=node)
        body["spec"]["accessModes"] = [mode]
        self.cp.api.create(VOLUMES, body)
        self._volumes.append(full)
        wanted = claim(name, "", modes=(mode,))
        wanted["spec"]["volumeName"] = full
        path = claims_path(self.stage.namespace)
        self.cp.api.create(path, wanted)
        self.stage.wait(
            lambda: self.cp.api.get(f"{path}/{name}")["status"].get("phase") == "Bound",
            what=lambda: f"claim {name} is not bound",
        )


def among(names: Sequence[str]) -> Json:
    """A pod's node affinity for these nodes; nothing for all of WORLD."""
    wanted = list(names) or [node.name for node in WORLD]
    term = {"matchExpressions": [{"key": str(Label.HOSTNAME), "operator": "In", "values": wanted}]}
    required = {"nodeSelectorTerms": [term]}
    return {"affinity": {"nodeAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": required}}}
