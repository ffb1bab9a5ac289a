"""Thesis §4.4.2 and listing 3.5: zones in the order a pod prefers them, and nodes that are shutting down."""

import json
from collections import Counter

from campaigns.scenarios.cluster import FIRST, OTHER, SECOND, Room
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


PLANNER = Room(200, 400)
LARGE_PLANNER = Room(1000, 2048)
MOST_REPLICAS = 40
PREFERS = {str(Annotation.TOPOLOGY): json.dumps({"preferred_zones": [FIRST, SECOND]})}


def with_room(place: Place) -> Verdict:
    """At most as many replicas as fit into the first zone: all go there."""
    room = place.cluster.places(place.cluster.in_zone(FIRST), PLANNER)
    return _judge(place, PLANNER, {FIRST: min(room, place.rng.randint(1, MOST_REPLICAS))})


def spill(place: Place) -> Verdict:
    """More replicas than fit into the first zone: it is filled, then the second one, then the rest of the cluster."""
    zones = {zone: place.cluster.places(place.cluster.in_zone(zone), LARGE_PLANNER) for zone in (FIRST, SECOND, OTHER)}
    replicas = zones[FIRST] + place.rng.randint(1, zones[SECOND] + min(3, zones[OTHER]))
    wanted: dict[str, int] = {}
    for zone, room in zones.items():
        wanted[zone] = min(room, replicas - sum(wanted.values()))
    return _judge(place, LARGE_PLANNER, wanted)


def shutting_down(place: Place) -> Verdict:
    """The nodes of the first zone shut down: pods that prefer it go to the second one."""
    draining = place.cluster.in_zone(FIRST)
    room = place.cluster.places(place.cluster.in_zone(SECOND), PLANNER)
    replicas = min(room, place.rng.randint(1, MOST_REPLICAS))
    with place.annotated(draining, Annotation.GRACEFUL_SHUTDOWN, "true"):
        return _judge(place, PLANNER, {SECOND: replicas})


def _judge(place: Place, pod: Room, wanted: dict[str, int]) -> Verdict:
    """Create as many pods as are wanted in all zones together, and compare where they went."""
    replicas = sum(wanted.values())
    pods = (place.pod(f"planner-{index:03}", room=pod, annotations=PREFERS) for index in range(replicas))
    nodes = place.until_settled(place.create(*pods))
    found = Counter(map(place.cluster.zone_of, nodes.values()))
    kept = sum(min(count, found[zone]) for zone, count in wanted.items())
    reason = "" if kept == replicas else f"wanted {wanted}, found {dict(found)}"
    return Verdict(kept, replicas, reason, {f"in {zone or 'none'}": count for zone, count in sorted(found.items())})
