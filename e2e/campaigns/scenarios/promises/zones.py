"""Thesis §4.4.2 and listing 3.5: zones in the order a pod prefers them, and nodes that are shutting down."""

import json
from collections import Counter

from campaigns.scenarios.cluster import FIRST, OTHER, SECOND, Room
from campaigns.scenarios.promises.place import Place, Verdict
from robotapp_api.model.names import Annotation

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
