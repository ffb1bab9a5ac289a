"""Features of a kubelet that a pod's spec needs, by the names under which nodes declare them."""

from typing import Final

from robotapp_scheduler.core.api.core_v1 import PodSpec

RESTART_ALL: Final = "RestartAllContainersOnContainerExits"
USER_NAMESPACES: Final = "UserNamespacesHostNetworkSupport"
MOUNT_OPTIONS: Final = "VolumeBindMountOptions"
NOTHING: Final[frozenset[str]] = frozenset()


def needs_of(spec: PodSpec) -> frozenset[str]:
    """Empty for nearly every pod."""
    containers = spec.containers if not spec.init_containers else [*spec.containers, *spec.init_containers]
    found: set[str] = set()
    if spec.host_network and not spec.host_users:
        found.add(USER_NAMESPACES)
    for container in containers:
        if any(rule.action == "RestartAllContainers" for rule in container.restart_policy_rules):
            found.add(RESTART_ALL)
        if any(mount.bind_mount_options for mount in container.volume_mounts):
            found.add(MOUNT_OPTIONS)
    return frozenset(found) if found else NOTHING
