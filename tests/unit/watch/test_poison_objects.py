"""Poison nodes, volumes, Services, apps …: taken over or left out, soon, and ordinary pods go on being placed."""

import json
import time
from contextlib import suppress
from typing import Any

import msgspec
import pytest
from tests.support.scheduler.poison import pod_body
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import make_core, make_node, to_pod
from tests.support.work_unit import is_within
from tests.unit.watch.poison_objects import POISON_OBJECTS

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.watch.routes import (
    Route,
    device_routes,
    group_routes,
    plain_routes,
    robotics_routes,
    storage_routes,
)

MOST_S = 0.8
"""CPU to take one of them over, on the machine of work_unit: ten times what the worst needs."""
CASES = [(plural, body) for plural, bodies in POISON_OBJECTS.items() for body in bodies]


def routes(cluster: Cache) -> list[Route]:
    return [
        *plain_routes(cluster),
        *robotics_routes(cluster),
        *storage_routes(cluster.volumes),
        *device_routes(cluster.resource_claims),
        *group_routes(cluster.pod_groups),
    ]


@pytest.mark.parametrize(
    ("plural", "body"), CASES, ids=lambda each: each if isinstance(each, str) else each["metadata"]["name"]
)
def test_a_poison_object_is_taken_or_left_out_soon_and_pods_go_on_being_placed(
    plural: str, body: dict[str, Any]
) -> None:
    core = make_core(*(make_node(f"n{index}") for index in range(50)))
    matching = [route for route in routes(core.cluster) if route.resource.plural == plural]
    assert matching, f"nobody watches {plural}"
    raw = json.dumps(body).encode()
    began_s = time.process_time()
    for route in matching:
        for _ in range(2):
            # What the feed counts as poison: an object that does not fit, or that cannot be taken over.
            with suppress(msgspec.ValidationError, ValueError, TypeError, AttributeError):
                route.apply(msgspec.json.decode(raw, type=route.as_type))
    for number in range(5):
        core.queue.add(to_pod(pod_body(f"healthy-{number}", metadata={"uid": f"u{number}"})))
        (decision,) = core.schedule(core.queue.pop())
        assert decision.placed, decision.message
        core.queue.done(decision.pod.uid)
    assert is_within(time.process_time() - began_s, 2 * len(matching) * MOST_S)
    check_queue(core.queue)
