"""Thesis §4.4.3, last part: pods that are created at once leave the queue by their class."""

import json
from collections import Counter

from campaigns.scenarios.cluster import Room
from campaigns.scenarios.promises.place import Place, Verdict
from robotapp_api.model.names import Annotation

CLASSES = ("realtime", "", "best_effort")
"""First to last; a pod without the annotation is in the middle."""
NODE = Room(1000, 128)


def by_class(place: Place) -> Verdict:
    """A node has room for some of the pods that wait for it: it is given by class, in whatever order they were created."""
    node = max(place.cluster.nodes, key=lambda each: place.cluster.places([each.name], NODE)).name
    room = place.cluster.places([node], NODE)
    count = max(len(CLASSES), room + place.rng.randint(1, room + 1))
    chosen = [*CLASSES, *(place.rng.choice(CLASSES) for _ in range(count - len(CLASSES)))]
    place.rng.shuffle(chosen)
    with place.running.away():
        pods = [
            place.pod(f"{index:02}", room=NODE, node=node, annotations=_policies(qos))
            for index, qos in enumerate(chosen)
        ]
        classes = dict(zip(place.create(*pods), chosen, strict=True))
    nodes = place.until_settled(list(classes))
    found = Counter(classes[name] for name, where in nodes.items() if where)
    wanted = Counter(sorted(chosen, key=CLASSES.index)[:room])
    kept = sum((found & wanted).values())
    reason = "" if kept == room else f"room for {room}: wanted {_named(wanted)}, found {_named(found)}"
    return Verdict(kept, room, reason, {"pods": count})


def _policies(qos_class: str) -> dict[str, str]:
    return {str(Annotation.POLICIES): json.dumps({"qos_class": qos_class})} if qos_class else {}


def _named(counts: Counter[str]) -> dict[str, int]:
    return {qos_class or "none": count for qos_class, count in counts.items()}
