"""Thesis §4.4.1: pods that need hardware are placed on nodes that have it."""

import json

from campaigns.scenarios.cluster import CAMERA, GPU, Room
from campaigns.scenarios.promises.place import Place, Verdict, judged
from robotapp_api.model.names import Annotation

DETECTOR = Room(200, 256)
MOST_REPLICAS = 20


def needs(**requirement: str) -> dict[str, str]:
    """The annotation of a pod with one hardware requirement."""
    return {str(Annotation.AFFINITY): json.dumps({"hardware_requirements": [requirement]})}


def gpu(place: Place) -> Verdict:
    """Replicas that need `type: gpu, model: nvidia`."""
    key, value = GPU.label
    with_gpu = place.cluster.labelled(key, value)
    replicas = min(place.rng.randint(3, MOST_REPLICAS), place.cluster.places(with_gpu, DETECTOR))
    annotations = needs(type="gpu", model="nvidia")
    names = place.create(
        *(place.pod(f"detector-{index:02}", room=DETECTOR, annotations=annotations) for index in range(replicas))
    )
    nodes = place.until_settled(names)
    kept = sum(node in with_gpu for node in nodes.values())
    reason = "" if kept == replicas else f"{replicas - kept} of {replicas} pods are not on a GPU node"
    return Verdict(kept, replicas, reason, {"GPU nodes": len(with_gpu), "nodes": len(place.cluster.nodes)})


def camera(place: Place) -> Verdict:
    """One pod that needs the USB camera one node has, and one that needs a camera no node has."""
    (home,) = place.cluster.labelled(CAMERA)
    driver, lost = place.create(
        place.pod("camera", annotations=needs(type="sensor", interface="usb-cam")),
        place.pod("lost", annotations=needs(type="sensor", interface="usb-missing")),
    )
    nodes = place.until_settled([driver, lost])
    return judged(
        {
            f"the camera pod is on {nodes[driver] or 'no node'}, not on {home}": nodes[driver] == home,
            f"a pod that needs a camera no node has is on {nodes[lost]}": not nodes[lost],
        }
    )
