"""NodeVolumeLimits: how many volumes of a CSI driver a node can hold."""

from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State, name_of, namespace_of
from campaigns.reference_scheduler.volumes import migration
from campaigns.reference_scheduler.volumes.storage import class_name, missing_claim, mounts, storage_class, volume_of

Volumes = dict[str, str]
"""Unique volume to its driver."""


def volume_limits(state: State, node: Json) -> Rejection | None:
    for mount in mounts(state, state.pod):
        if mount.claim is None:
            return Rejection((missing_claim(mount.claim_name),), final=True)
    has_drivers = any(name_of(each) == name_of(node) for each in state.cluster.csi_nodes)
    wanted = _volumes(state, state.pod, migrated=has_drivers)
    if not wanted:
        return None
    drivers = _drivers(state, node)
    for driver in sorted(set(wanted.values())):
        if driver not in drivers and _must_be_installed(state, driver):
            return Rejection((f"{driver} CSI driver is not installed on the node",))
    used = _used(state, node)
    # A volume of the pod that is attached without a pod on the node counts twice, as upstream.
    held = [*used.values(), *(driver for volume, driver in _attached(state, node).items() if volume not in used)]
    new = [driver for volume, driver in wanted.items() if volume not in used]
    for driver in set(new):
        limit = drivers.get(driver)
        if limit is not None and held.count(driver) + new.count(driver) > limit:
            return Rejection(("node(s) exceed max volume count",))
    return None


def _used(state: State, node: Json) -> Volumes:
    found: Volumes = {}
    for other in state.on(node):
        found.update(_volumes(state, other, migrated=True))
    return found


def _attached(state: State, node: Json) -> Volumes:
    """By VolumeAttachment, whoever it is for."""
    found: Volumes = {}
    for attachment in state.cluster.volume_attachments:
        volume = volume_of(state, attachment["spec"]["source"].get("persistentVolumeName") or "")
        if attachment["spec"]["nodeName"] == name_of(node) and volume and volume["spec"].get("csi"):
            driver = attachment["spec"]["attacher"]
            found[f"{driver}/{volume['spec']['csi']['volumeHandle']}"] = driver
    return found


def _volumes(state: State, pod: Json, *, migrated: bool) -> Volumes:
    """The pod's CSI volumes; a claim without a volume counts for its class's provisioner.

    `migrated`: those of the old kinds count for the driver that took them over.
    """
    found: Volumes = {}
    for mount in mounts(state, pod):
        if mount.claim is None:
            continue
        volume = volume_of(state, mount.claim["spec"].get("volumeName") or "")
        if volume is None:
            offered = storage_class(state, class_name(mount.claim))
            driver = migration.driver_of_provisioner(offered["provisioner"]) if offered is not None else None
            if (
                offered is not None
                and driver
                and (migrated or not migration.in_tree_provisioner(offered["provisioner"]))
            ):
                found[f"{driver}/claim {namespace_of(mount.claim)}/{mount.claim_name}"] = driver
        elif volume["spec"].get("csi"):
            csi = volume["spec"]["csi"]
            found[f"{csi['driver']}/{csi['volumeHandle']}"] = csi["driver"]
        elif migrated:
            found |= _in_tree(volume["spec"], volume["metadata"].get("labels") or {})
    for inline in pod["spec"].get("volumes") or [] if migrated else []:
        found |= _in_tree(inline, {})
    return found


def _in_tree(source: Json, labels: Json) -> Volumes:
    known = migration.driver_and_handle(source, labels)
    return {f"{known[0]}/{known[1]}": known[0]} if known else {}


def _drivers(state: State, node: Json) -> dict[str, int | None]:
    """Drivers on the node with their limit; None is no limit."""
    for each in state.cluster.csi_nodes:
        if name_of(each) == name_of(node):
            return {d["name"]: (d.get("allocatable") or {}).get("count") for d in each["spec"].get("drivers") or []}
    return {}


def _must_be_installed(state: State, driver: str) -> bool:
    if state.config.compat_version == "1.35":
        return False
    return any(
        name_of(each) == driver and each["spec"].get("preventPodSchedulingIfMissing")
        for each in state.cluster.csi_drivers
    )
