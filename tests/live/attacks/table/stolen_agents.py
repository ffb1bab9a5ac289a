"""What a stolen token of the node agent or of the labeller is tried for."""

from typing import Any, Final

from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Json, Kind, Stop

NODE: Final = "attacked-node"
"""The node whose agent's token was stolen; the world makes it, with its telemetry."""
OTHER: Final = "attacked-other-node"
_SYSTEM: Final = "robotapp-agent"
_LABEL: Final = "metadata.labels"


def _telemetry(key: str, text: str, changes: Json, *, node: str = NODE, sub: str = "", there: bool = True) -> Attack:
    return Attack(
        key, text, "agent", kinds.TELEMETRY, {}, changes, Stop.AGENT, name=node, subresource=sub, there=there
    )  # fmt: skip


def _owner(name: str, uid: str) -> Json:
    return {"metadata.ownerReferences": [{"apiVersion": "v1", "kind": "Node", "name": name, "uid": uid}]}


def _denied(who: str, key: str, text: str, kind: Kind, changes: Json, *, name: str = "x", sub: str = "") -> Attack:
    return Attack(key, text, who, kind, {}, changes, Stop.RBAC, where=_SYSTEM, name=name, subresource=sub)


def _node(key: str, text: str, changes: dict[str, Any]) -> Attack:
    return Attack(key, text, "labeller", kinds.NODE, {}, changes, Stop.LABELLER, name=NODE, there=True)


AGENT: Final = (
    _telemetry("agent-other-status", "report for another node", {"status.seq": 7}, node=OTHER, sub="status"),
    _telemetry("agent-other", "what another node's agent is to measure", {"spec.probe": [NODE]}, node=OTHER),
    _telemetry("agent-nowhere", "a node that does not exist", {"status": {}}, node="attacked-no-node", there=False),
    _telemetry("agent-probe", "what the own node's agent is to measure", {"spec.probe": [OTHER]}),
    _telemetry("agent-label", "a label on the own telemetry", {f'{_LABEL}."robotics.io/simulated"': "true"}),
    _telemetry("agent-annotation", "an annotation there", {'metadata.annotations."robotics.io/allowed-namespaces"': "x"}),
    _telemetry("agent-finalizer", "a finalizer there", {"metadata.finalizers": ["robotics.io/stay"]}),
    _telemetry("agent-owner", "another node as its owner", _owner(OTHER, "u-1")),
    _telemetry("agent-owner-uid", "an earlier node of the name as its owner", _owner(NODE, "u-1")),
    _denied("agent", "agent-node-label", "a label on the own node", kinds.NODE, {f'{_LABEL}."a"': "b"}, name=NODE),
    _denied("agent", "agent-node-device", "a device by the own node's label", kinds.NODE,
            {f'{_LABEL}."hardware.robotics.io/can-can0"': "true"}, name=NODE),
    _denied("agent", "agent-taint", "take the taint off the own node", kinds.NODE, {"spec.taints": []}, name=NODE),
    _denied("agent", "agent-node-status", "more devices of the own node", kinds.NODE, {"status": {}}, name=NODE, sub="status"),
    _denied("agent", "agent-key", "another key of the measurements", kinds.SECRET, {"data": {}}, name="robotapp-agent-key"),
    _denied("agent", "agent-pod", "a privileged pod beside the agent", kinds.POD, {"spec": {}}),
    _denied("agent", "agent-daemonset", "the agent's image", kinds.DAEMONSET, {"spec": {}}, name="robotapp-agent"),
    _denied("agent", "agent-devices", "rules for devices", kinds.CONFIGMAP, {"data": {}}, name="robotapp-agent-devices"),
    _denied("agent", "agent-app", "a RobotApp", kinds.ROBOTAPP, {"spec": {}}),
    _denied("agent", "agent-claim", "claim a device", kinds.CLAIM, {"spec": {}}),
    _denied("agent", "agent-pool", "the pool", kinds.POOL, {"spec": {}}, name="default"),
    _denied("agent", "agent-role", "a role", kinds.CLUSTER_ROLE, {"rules": []}),
    _denied("agent", "agent-policy", "empty the policy of the agents", kinds.POLICY, {"spec": {}}, name="robotapp-agent"),
)  # fmt: skip

LABELLER: Final = (
    _node("labeller-robot", "make a node a robot", {f'{_LABEL}."robotics.io/robot"': "amr-07"}),
    _node("labeller-zone", "move a node to another zone", {f'{_LABEL}."topology.kubernetes.io/zone"': "x"}),
    _node("labeller-prefix", "a label whose name only begins alike", {f'{_LABEL}."hardware.robotics.io.evil/x"': "x"}),
    _node("labeller-beside", "the same beside a label it may write", {
        f'{_LABEL}."hardware.robotics.io/can"': "true", f'{_LABEL}."robotics.io/robot"': "amr-07"}),
    _node("labeller-taint", "a taint that drives pods away", {"spec.taints": [{"key": "k", "effect": "NoExecute"}]}),
    _node("labeller-cordon", "close a node", {"spec.unschedulable": True}),
    _node("labeller-annotation", "admit a namespace to a robot", {'metadata.annotations."robotics.io/allowed-namespaces"': "own"}),
    _node("labeller-finalizer", "keep a node for ever", {"metadata.finalizers": ["robotics.io/stay"]}),
    _denied("labeller", "labeller-status", "more resources of a node", kinds.NODE, {"status": {}}, name=NODE, sub="status"),
    _denied("labeller", "labeller-telemetry", "report devices", kinds.TELEMETRY, {"status": {}}, name=NODE, sub="status"),
    _denied("labeller", "labeller-pod", "a pod", kinds.POD, {"spec": {}}),
    _denied("labeller", "labeller-secret", "a Secret", kinds.SECRET, {"data": {}}),
    _denied("labeller", "labeller-policy", "empty the policy of the labeller", kinds.POLICY, {"spec": {}}, name="robotapp-labeller"),
)  # fmt: skip

STOLEN: Final = (*AGENT, *LABELLER)
