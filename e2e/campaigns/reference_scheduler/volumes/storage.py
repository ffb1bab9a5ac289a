"""Claims, volumes and classes of a pod, as the volume plugins look them up."""

from dataclasses import dataclass

from campaigns.reference_scheduler.labels import labels_of, term_matches
from campaigns.reference_scheduler.model import Json
from campaigns.reference_scheduler.quantities import units
from campaigns.reference_scheduler.state import State, name_of, namespace_of

NOT_PROVISIONED = "kubernetes.io/no-provisioner"
_CLASS = "volume.beta.kubernetes.io/storage-class"
_BOUND = "pv.kubernetes.io/bind-completed"


@dataclass(frozen=True)
class Mount:
    """A pod volume that stands for a claim; `claim` is None when the claim does not exist."""

    claim_name: str
    ephemeral: bool
    claim: Json | None


def mounts(state: State, pod: Json) -> list[Mount]:
    found = []
    for volume in pod["spec"].get("volumes") or []:
        ephemeral = volume.get("ephemeral") is not None
        if ephemeral:
            name = f"{name_of(pod)}-{volume['name']}"
        elif volume.get("persistentVolumeClaim"):
            name = volume["persistentVolumeClaim"]["claimName"]
        else:
            continue
        found.append(Mount(name, ephemeral, claim_of(state, namespace_of(pod), name)))
    return found


def claim_of(state: State, namespace: str, name: str) -> Json | None:
    for claim in state.cluster.claims:
        if (namespace_of(claim), name_of(claim)) == (namespace, name):
            return claim
    return None


def volume_of(state: State, name: str) -> Json | None:
    return next((each for each in state.cluster.volumes if name_of(each) == name), None)


def storage_class(state: State, name: str) -> Json | None:
    return next((each for each in state.cluster.storage_classes if name_of(each) == name), None)


def class_name(item: Json) -> str:
    """Of a claim or a volume; the old annotation goes first."""
    annotations = item["metadata"].get("annotations") or {}
    return str(annotations.get(_CLASS) or item["spec"].get("storageClassName") or "")


def fully_bound(claim: Json) -> bool:
    return bool(claim["spec"].get("volumeName")) and _BOUND in (claim["metadata"].get("annotations") or {})


def waits_for_consumer(state: State, claim: Json) -> bool:
    found = storage_class(state, class_name(claim))
    return found is not None and found.get("volumeBindingMode") == "WaitForFirstConsumer"


def requested_bytes(claim: Json) -> int:
    requests = (claim["spec"].get("resources") or {}).get("requests") or {}
    return units(requests.get("storage", "0"))


def capacity_bytes(volume: Json) -> int:
    return units((volume["spec"].get("capacity") or {}).get("storage", "0"))


def reaches(volume: Json, node: Json) -> bool:
    """The volume's node affinity against the node's labels."""
    required = ((volume["spec"].get("nodeAffinity") or {}).get("required")) or None
    if required is None:
        return True
    return any(term_matches(term, labels_of(node), "") for term in required.get("nodeSelectorTerms") or [])


def missing_claim(name: str) -> str:
    return f'persistentvolumeclaim "{name}" not found'
