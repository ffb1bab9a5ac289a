"""NodeDeclaredFeatures: needs read off the pod, against status.declaredFeatures of the node."""

from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State

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
