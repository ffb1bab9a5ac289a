"""NodeName, NodeUnschedulable, TaintToleration, NodePorts, NodeDeclaredFeatures."""

from campaigns.reference_scheduler.labels import tolerates, untolerated
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State, name_of

RESTART_ALL = "RestartAllContainersOnContainerExits"
HOST_NETWORK = "UserNamespacesHostNetworkSupport"
BIND_OPTIONS = "VolumeBindMountOptions"


def declared_features(state: State, node: Json) -> Rejection | None:
    """The plugin is on by default since 1.36."""
    if state.config.compat_version == "1.35":
        return None
    declared = (node.get("status") or {}).get("declaredFeatures") or []
    if all(need in declared for need in needs(state.pod)):
        return None
    return Rejection(("node(s) didn't match Pod's required features",), final=True)


def needs(pod: Json) -> set[str]:
    spec = pod["spec"]
    found = set()
    if spec.get("hostNetwork") and spec.get("hostUsers") is False:
        found.add(HOST_NETWORK)
    for container in [*(spec.get("initContainers") or []), *spec["containers"]]:
        if any(rule.get("action") == "RestartAllContainers" for rule in container.get("restartPolicyRules") or []):
            found.add(RESTART_ALL)
        if any(mount.get("bindMountOptions") for mount in container.get("volumeMounts") or []):
            found.add(BIND_OPTIONS)
    return found


_ANY = "0.0.0.0"  # noqa: S104 - a value of the API
Port = tuple[str, str, int]


def node_name(state: State, node: Json) -> Rejection | None:
    wanted = state.pod["spec"].get("nodeName")
    if wanted and wanted != name_of(node):
        return Rejection(("node(s) didn't match the requested node name",), final=True)
    return None


def node_unschedulable(state: State, node: Json) -> Rejection | None:
    cordon = {"key": "node.kubernetes.io/unschedulable", "effect": "NoSchedule"}
    if (node.get("spec") or {}).get("unschedulable") and not tolerates(state.pod, cordon):
        return Rejection(("node(s) were unschedulable",), final=True)
    return None


def taint_toleration(state: State, node: Json) -> Rejection | None:
    if untolerated(state.pod, node):
        return Rejection(("node(s) had untolerated taint(s)",), final=True)
    return None


def taint_score(state: State, feasible: list[Json]) -> dict[str, int]:
    """Raw: how many PreferNoSchedule taints the pod does not tolerate; fewer is better."""
    soft = [t for t in state.pod["spec"].get("tolerations") or [] if t.get("effect") in {None, "", "PreferNoSchedule"}]
    willing = {"spec": {"tolerations": soft}}
    found = {}
    for node in feasible:
        taints = (node.get("spec") or {}).get("taints") or []
        found[name_of(node)] = sum(
            1 for taint in taints if taint["effect"] == "PreferNoSchedule" and not tolerates(willing, taint)
        )
    return found


def node_ports(state: State, node: Json) -> Rejection | None:
    taken = [port for other in state.on(node) for port in host_ports(other)]
    if any(_conflict(mine, theirs) for mine in host_ports(state.pod) for theirs in taken):
        return Rejection(("node(s) didn't have free ports for the requested pod ports",))
    return None


def host_ports(pod: Json) -> list[Port]:
    """(IP, protocol, port) of containers and sidecars."""
    sidecars = [step for step in pod["spec"].get("initContainers") or [] if step.get("restartPolicy") == "Always"]
    return [
        (port.get("hostIP") or _ANY, port.get("protocol") or "TCP", int(port["hostPort"]))
        for container in [*pod["spec"]["containers"], *sidecars]
        for port in container.get("ports") or []
        if port.get("hostPort")
    ]


def _conflict(mine: Port, theirs: Port) -> bool:
    return mine[1:] == theirs[1:] and (mine[0] == theirs[0] or _ANY in {mine[0], theirs[0]})
