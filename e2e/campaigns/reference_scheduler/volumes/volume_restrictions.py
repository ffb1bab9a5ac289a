"""VolumeRestrictions: ReadWriteOncePod claims and inline disks that only one may write."""

from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State, namespace_of
from campaigns.reference_scheduler.volumes.storage import Mount, missing_claim, mounts

_RWOP_TEXT = (
    "node(s) unavailable due to PersistentVolumeClaim with ReadWriteOncePod access mode already in-use by another pod"
)


def _plain(state: State, pod: Json) -> list[Mount]:
    return [mount for mount in mounts(state, pod) if not mount.ephemeral]


def pre_filter(state: State) -> Rejection | None:
    for mount in _plain(state, state.pod):
        if mount.claim is None:
            return Rejection((missing_claim(mount.claim_name),), final=True)
    return None


def volume_restrictions(state: State, node: Json) -> Rejection | None:
    if any(_disks_conflict(state.pod, other) for other in state.on(node)):
        return Rejection(("node(s) had no available disk",))
    if state.once("exclusive claims in use", _exclusive_in_use):
        return Rejection((_RWOP_TEXT,))
    return None


def _exclusive_in_use(state: State) -> bool:
    """Anywhere in the cluster, so the answer is the same for every node.

    A claim in use at PreFilter counts once, however many pods have it; each mount that a trial takes away or adds counts
    for itself. Nothing is asked again in a trial where nothing was in use and no disk is inline.
    """
    exclusive = {
        mount.claim_name
        for mount in _plain(state, state.pod)
        if mount.claim and "ReadWriteOncePod" in (mount.claim["spec"].get("accessModes") or [])
    }
    at_start = [name for pods in state.at_start.values() for name in _exclusive_mounts(state, pods, exclusive)]
    now = [name for pods in state.placed.values() for name in _exclusive_mounts(state, pods, exclusive)]
    count = len(set(at_start))
    inline = any(kind in volume for volume in state.pod["spec"].get("volumes") or [] for kind in _SAME)
    return (count > 0 or inline) and count + len(now) - len(at_start) > 0


def _exclusive_mounts(state: State, pods: list[Json], exclusive: set[str]) -> list[str]:
    return [
        mount.claim_name
        for other in pods
        if namespace_of(other) == namespace_of(state.pod)
        for mount in _plain(state, other)
        if mount.claim_name in exclusive
    ]


def _disks_conflict(pod: Json, other: Json) -> bool:
    return any(
        _same_disk(mine, theirs)
        for mine in pod["spec"].get("volumes") or []
        for theirs in other["spec"].get("volumes") or []
    )


def _same_disk(mine: Json, theirs: Json) -> bool:
    for kind, same in _SAME.items():
        left, right = mine.get(kind), theirs.get(kind)
        if left and right and same(left, right):
            shared = kind != "awsElasticBlockStore" and left.get("readOnly") and right.get("readOnly")
            return not shared
    return False


_SAME = {
    "gcePersistentDisk": lambda left, right: left["pdName"] == right["pdName"],
    "awsElasticBlockStore": lambda left, right: left["volumeID"] == right["volumeID"],
    "iscsi": lambda left, right: left["iqn"] == right["iqn"],
    "rbd": lambda left, right: (
        bool(set(left["monitors"]) & set(right["monitors"]))
        and (left.get("pool") or "rbd", left["image"]) == (right.get("pool") or "rbd", right["image"])
    ),
}
