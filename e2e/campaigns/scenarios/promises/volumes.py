"""Thesis §4.4.3: a coordinator and its volume, which all nodes reach or one.

The schedulers have a watch for each kind, so a pod may be refused until its claim is known: the scenarios wait for the node.
"""

import json

from campaigns.scenarios.cluster import Json
from campaigns.scenarios.promises.place import Place, Verdict, judged
from robotapp_api.model.names import Annotation, Label
from robotapp_client.api.resources import PERSISTENTVOLUMECLAIMS, PERSISTENTVOLUMES

REPETITIONS = 3
MOST_ROBOTS = 5


def shared_by_all(place: Place) -> Verdict:
    """A ReadWriteMany claim keeps its pods from no node: each of them reaches the one it asks for."""
    count = min(REPETITIONS, len(place.cluster.nodes))
    homes = [node.name for node in place.rng.sample(place.cluster.nodes, count)]
    claim = _bound_claim(place, "map", "ReadWriteMany")
    pods = [place.pod(f"reader-{index}", node=home, volumes=_mounts(claim)) for index, home in enumerate(homes)]
    names = place.create(*pods)
    nodes = place.until_bound(names)
    return judged(
        {
            f"{name} is on {nodes[name] or 'no node'}, not on {home}": nodes[name] == home
            for name, home in zip(names, homes, strict=True)
        }
    )


def of_one_node(place: Place) -> Verdict:
    """A ReadWriteOnce claim on one node's volume: its pods go there, and one that must go elsewhere waits."""
    home, other = (node.name for node in place.rng.sample(place.cluster.nodes, 2))
    claim = _bound_claim(place, "map", "ReadWriteOnce", node=home)
    coordinators = [place.pod(f"coordinator-{index}", volumes=_mounts(claim)) for index in range(REPETITIONS)]
    names = place.create(*coordinators)
    (elsewhere,) = place.create(place.pod("elsewhere", node=other, volumes=_mounts(claim)))
    nodes = place.until_bound(names) | place.until_settled([elsewhere])
    wanted = dict.fromkeys(names, home) | {elsewhere: ""}
    return judged({f"{name} is on {nodes[name] or 'no node'}": nodes[name] == where for name, where in wanted.items()})


def fleet(place: Place) -> Verdict:
    """A coordinator goes to its volume, and the robots that name it as their peer go to the coordinator."""
    home = place.rng.choice(place.cluster.nodes).name
    claim = _bound_claim(place, "map", "ReadWriteOnce", node=home)
    (coordinator,) = place.create(place.pod("coordinator", volumes=_mounts(claim)))
    place.until_bound([coordinator])
    beside = {str(Annotation.SHARED_DATA): json.dumps({"peer_pods": [coordinator]})}
    robots = [place.pod(f"robot-{index}", annotations=beside) for index in range(place.rng.randint(2, MOST_ROBOTS))]
    nodes = place.until_bound([coordinator, *place.create(*robots)])
    return judged({f"{name} is on {node or 'no node'}, not on {home}": node == home for name, node in nodes.items()})


def _bound_claim(place: Place, name: str, mode: str, *, node: str = "") -> str:
    """A volume claim that is bound to a volume of its own, which `node` alone reaches or every node; its name."""
    name = f"{place.prefix}-{name}"
    volume = f"{place.namespace}-{name}"
    ref = {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "namespace": place.namespace, "name": name}
    common: Json = {"accessModes": [mode], "storageClassName": ""}
    spec = common | {"capacity": {"storage": "1Gi"}, "hostPath": {"path": f"/var/robotapp/{name}"}, "claimRef": ref}
    if node:
        term = {"matchExpressions": [{"key": str(Label.HOSTNAME), "operator": "In", "values": [node]}]}
        spec["nodeAffinity"] = {"required": {"nodeSelectorTerms": [term]}}
    place.cp.api.create(PERSISTENTVOLUMES.path(), {"metadata": {"name": volume}, "spec": spec})
    place.volumes.append(volume)
    wanted = common | {"volumeName": volume, "resources": {"requests": {"storage": "1Gi"}}}
    path = PERSISTENTVOLUMECLAIMS.path(place.namespace)
    place.cp.api.create(path, {"metadata": {"name": name}, "spec": wanted})

    def bound() -> bool:
        found = place.watch.get(PERSISTENTVOLUMECLAIMS, f"{place.namespace}/{name}") or {}
        return bool(found.get("status", {}).get("phase") == "Bound")

    place.until(bound, what=lambda: f"claim {name} is not bound to its volume")
    return name


def _mounts(claim: str) -> list[Json]:
    return [{"name": "data", "persistentVolumeClaim": {"claimName": claim}}]
