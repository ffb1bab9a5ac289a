"""Placed pods by namespace and name, and by the name of their Deployment."""

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.pods.pod_info import PlacedPod
from robotapp_scheduler.core.pods.pod_signature import controller_of


class NameIndex:
    """Answers which placed pods somebody may mean by a name."""

    def __init__(self) -> None:
        self._by_name: dict[tuple[str, str], str] = {}
        """Uid of the placed pod of this namespace and name: one string per pod, tens of thousands of times."""
        self._by_deployment: dict[tuple[str, str], dict[str, None]] = {}

    def __repr__(self) -> str:
        return f"NameIndex({len(self._by_name)} pods, {len(self._by_deployment)} Deployments)"

    def add(self, record: PlacedPod) -> None:
        """A pod was placed."""
        self._by_name[record.namespace, record.name] = record.uid
        if deployment := _deployment_of(record.pod):
            self._by_deployment.setdefault((record.namespace, deployment), {})[record.uid] = None

    def remove(self, record: PlacedPod) -> None:
        """A placed pod is gone."""
        key = (record.namespace, record.name)
        if self._by_name.get(key) == record.uid:
            del self._by_name[key]
        deployment = _deployment_of(record.pod)
        uids = self._by_deployment.get((record.namespace, deployment)) if deployment else None
        if uids is not None:
            uids.pop(record.uid, None)
            if not uids:
                del self._by_deployment[record.namespace, deployment]

    def uids(self, namespace: str, name: str) -> list[str]:
        """Uids of the pod with this name and of the pods of the Deployment with this name, each once."""
        own = self._by_name.get((namespace, name))
        of_deployment = self._by_deployment.get((namespace, name), ())
        return list(dict.fromkeys([own, *of_deployment] if own is not None else of_deployment))


def _deployment_of(pod: Pod) -> str:
    """Name of the pod's Deployment (its ReplicaSet's without the hash), "" when it has none."""
    owner = controller_of(pod.metadata.owner_references)
    return owner.name.rpartition("-")[0] if owner is not None and owner.kind == "ReplicaSet" else ""
