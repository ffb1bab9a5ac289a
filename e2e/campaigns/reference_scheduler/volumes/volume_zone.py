"""VolumeZone: zone and region labels of bound volumes."""

from campaigns.reference_scheduler.labels import labels_of
from campaigns.reference_scheduler.model import Json, Rejection
from campaigns.reference_scheduler.state import State
from campaigns.reference_scheduler.volumes.storage import mounts, volume_of

_GENERAL = {
    "failure-domain.beta.kubernetes.io/zone": "topology.kubernetes.io/zone",
    "failure-domain.beta.kubernetes.io/region": "topology.kubernetes.io/region",
}
_KEYS = (*_GENERAL, *_GENERAL.values())


def pre_filter(state: State) -> Rejection | None:
    """VolumeBinding has refused before whatever is neither bound nor waiting; a volume may still not exist."""
    for mount in mounts(state, state.pod):
        name = (mount.claim or {"spec": {}})["spec"].get("volumeName")
        if name and not mount.ephemeral and volume_of(state, name) is None:
            return Rejection((f'persistentvolume "{name}" not found',), final=True)
    return None


def volume_zone(state: State, node: Json) -> Rejection | None:
    labels = labels_of(node)
    if not any(key in labels for key in _KEYS):
        return None
    for mount in mounts(state, state.pod):
        if mount.ephemeral or mount.claim is None:
            continue
        volume = volume_of(state, mount.claim["spec"].get("volumeName") or "")
        for key, allowed in _topology(volume).items():
            value = labels.get(key, labels.get(_GENERAL.get(key, key)))
            if value is None or value not in allowed:
                return Rejection(("node(s) had no available volume zone",), final=True)
    return None


def _topology(volume: Json | None) -> dict[str, set[str]]:
    """Key to the allowed values; a set with an empty member is unreadable and left out."""
    labels = labels_of(volume) if volume else {}
    found = {key: set(labels[key].split("__")) for key in _KEYS if key in labels}
    return {key: values for key, values in found.items() if "" not in values}
