"""A real API server writes news of a pod so that what is known of it is recognised."""

import asyncio

import pytest
from tests.integration.client.conftest import Place
from tests.integration.client.test_mirrors import running
from tests.support.clients import until

from robotapp_api.client import Change, Reflector
from robotapp_api.client.api.bodies import encode
from robotapp_api.client.api.resources import PODS
from robotapp_scheduler.core.api.core_v1 import Pod


@pytest.mark.parametrize("place", [pytest.param("real", marks=pytest.mark.live)], indirect=True)
async def test_of_a_pod_that_is_bound_and_starts_only_what_is_new_is_decoded(place: Place) -> None:
    told: list[Change] = []
    client, namespace = place.client, place.namespace
    mirror = Reflector(
        client,
        PODS,
        as_type=Pod,
        namespace=namespace,
        on_change=told.append,
        fixed_keys=True,
        known_specs=True,
    )
    spec = {"schedulerName": "nobody", "containers": [{"name": "main", "image": "registry.example.com/a:1"}]}
    async with running(mirror.run()):
        await asyncio.wait_for(mirror.synced.wait(), 60)
        await client.create(PODS, {"metadata": {"name": "a", "labels": {"a": "a"}}, "spec": spec}, namespace=namespace)
        await until(lambda: len(told) == 1)
        binding = {"metadata": {"name": "a"}, "target": {"kind": "Node", "name": "n-1"}}
        await client.post_raw(PODS.path(namespace, "a", "binding"), encode(binding))
        await until(lambda: len(told) == 2)
        await client.patch(PODS, "a", {"status": {"phase": "Running"}}, namespace=namespace, subresource="status")
        await until(lambda: len(told) == 3)
    made, bound, started = (change.new for change in told)
    assert (made.spec.node_name, bound.spec.node_name, started.status.phase) == ("", "n-1", "Running")
    assert bound.spec.containers is made.spec.containers
    assert started.spec is bound.spec
    assert started.metadata.labels is bound.metadata.labels
