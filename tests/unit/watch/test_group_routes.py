"""PodGroups of an API server that may not have them: asked for once, and again only while a pod waits for one."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, until
from tests.support.scheduler.pod_groups import team_pod
from tests.support.scheduling import Clock

from robotapp_client.api.resources import COSCHEDULING_PODGROUPS, ROBOTAPPS, WORKLOAD_PODGROUPS
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_group_index import COSCHEDULING, GroupRef
from robotapp_scheduler.shell.informers import informers as feeding
from robotapp_scheduler.shell.informers.informers import Informers
from robotapp_scheduler.shell.metrics.metrics import Metrics


async def test_they_cost_one_question_each_until_a_pod_names_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeding, "CRD_POLL_S", 0.01)
    cluster = Cache(clock=Clock())
    roots = (COSCHEDULING_PODGROUPS.root, WORKLOAD_PODGROUPS.root)
    installed = False
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        ask = client.request

        async def request(method: str, path: str, *rest: Any, **fields: Any) -> Any:
            if installed and path == COSCHEDULING_PODGROUPS.root:
                return SimpleNamespace(body=b'{"resources": [{"name": "podgroups"}]}')
            return await ask(method, path, *rest, **fields)

        def asked(path: str) -> int:
            return sum(found == path for _, found in server.requests)

        monkeypatch.setattr(client, "request", request)
        feed = Informers(client, cluster, on_pod=lambda _: Change.NONE, on_change=lambda _: None, metrics=Metrics())
        task = asyncio.create_task(feed.run())
        await until(lambda: asked(ROBOTAPPS.root) >= 5, what="several looks for our own CRDs")
        assert [asked(root) for root in roots] == [1, 1]

        cluster.apply_pod(team_pod("p"))
        await until(lambda: asked(roots[0]) >= 3, what="looks for the group of a waiting pod")
        assert asked(roots[1]) == 1

        group = {"metadata": {"name": "team", "namespace": "default"}, "spec": {"minMember": 2}}
        await client.create(COSCHEDULING_PODGROUPS, group, namespace="default")
        installed = True
        ref = GroupRef(COSCHEDULING, "default", "team")
        await until(lambda: cluster.pod_groups.find(ref), what="the group is seen")
        assert cluster.pod_groups.quorum(ref) == 2
        await client.delete(COSCHEDULING_PODGROUPS, "team", namespace="default")
        await until(lambda: cluster.pod_groups.find(ref) is None, what="the group is gone")
        task.cancel()
