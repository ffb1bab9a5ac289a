from collections.abc import AsyncIterator, Mapping
from typing import Any

import aiohttp
import pytest
from prometheus_client import CollectorRegistry

from robotapp_api.client.errors import Unreachable
from robotapp_scheduler.shell.access import Access
from robotapp_scheduler.shell.health import Pages, serve
from robotapp_scheduler.shell.metrics import Metrics


class Site:
    """The endpoint with switches for everything it asks."""

    def __init__(self) -> None:
        self.ready = True
        self.live = True
        self.access: Access | Exception = Access.ALL
        self.asked: list[tuple[str, str]] = []
        self.metrics = Metrics(CollectorRegistry())
        self.pages = Pages(
            registry=self.metrics.registry,
            config=lambda: {"profiles": ["ours"]},
            explain=self.explain,
            authorize=self.authorize,
            ready_checks={"informers-sync": lambda: self.ready},
            live_checks={"leader-election": lambda: self.live},
        )

    @staticmethod
    def explain(namespace: str, pod: str, with_nodes: bool) -> Mapping[str, Any] | None:
        return {"pod": pod, "nodes": with_nodes} if namespace == "team-a" else None

    async def authorize(self, token: str, namespace: str) -> Access:
        self.asked.append((token, namespace))
        if isinstance(self.access, Exception):
            raise self.access
        return self.access


@pytest.fixture
async def site() -> AsyncIterator[tuple[Site, str]]:
    found = Site()
    runner, port = await serve(found.pages, host="127.0.0.1", port=0)
    yield found, f"http://127.0.0.1:{port}"
    await runner.cleanup()


async def get(url: str, **headers: str) -> tuple[int, str]:
    async with aiohttp.ClientSession() as session, session.get(url, headers=headers) as response:
        return response.status, await response.text()


async def test_live_and_ready_say_ok(site: tuple[Site, str]) -> None:
    _, url = site
    for path in ("livez", "healthz", "readyz"):
        assert await get(f"{url}/{path}") == (200, "ok")


async def test_readiness_names_what_is_missing(site: tuple[Site, str]) -> None:
    found, url = site
    found.ready = False
    assert await get(f"{url}/readyz") == (503, "[-]informers-sync failed\n")
    assert await get(f"{url}/livez") == (200, "ok")


async def test_a_lost_lease_fails_both(site: tuple[Site, str]) -> None:
    found, url = site
    found.live = False
    assert (await get(f"{url}/livez"))[0] == (await get(f"{url}/readyz"))[0] == 503


async def test_metrics_carry_upstream_names_and_buckets(site: tuple[Site, str]) -> None:
    found, url = site
    found.metrics.attempts.labels("scheduled", "ours").inc()
    found.metrics.sli_s.labels("1").observe(0.02)
    found.metrics.watch("pending_pods", "Waiting pods", label="queue", read=lambda: {"active": 3})
    status, text = await get(f"{url}/metrics")
    assert status == 200
    assert 'scheduler_schedule_attempts_total{profile="ours",result="scheduled"} 1.0' in text
    assert 'scheduler_pod_scheduling_sli_duration_seconds_bucket{attempts="1",le="0.02"} 1.0' in text
    assert 'scheduler_pending_pods{queue="active"} 3.0' in text


async def test_configz_shows_what_the_process_runs_with(site: tuple[Site, str]) -> None:
    _, url = site
    assert '"profiles":["ours"]' in (await get(f"{url}/configz"))[1]


async def test_explain_passes_the_bearer_token_and_hides_nodes_from_who_may_not_get_them(
    site: tuple[Site, str],
) -> None:
    found, url = site
    assert await get(f"{url}/explain/team-a/p", Authorization="Bearer t1") == (200, '{"pod":"p","nodes":true}')
    found.access = Access.WITHOUT_NODES
    assert (await get(f"{url}/explain/team-a/p", Authorization="Bearer t1"))[1] == '{"pod":"p","nodes":false}'
    assert found.asked == [("t1", "team-a")] * 2


@pytest.mark.parametrize(
    ("access", "status", "text"),
    [
        (Access.UNKNOWN_CALLER, 401, "bearer token"),
        (Access.FORBIDDEN, 403, "may not get pods in namespace team-a"),
        (Unreachable("down", maybe_applied=False), 503, "cannot say who you are"),
    ],
)
async def test_explain_refuses_with_a_reason(
    site: tuple[Site, str], access: Access | Exception, status: int, text: str
) -> None:
    found, url = site
    found.access = access
    answer = await get(f"{url}/explain/team-a/p")
    assert answer[0] == status
    assert text in answer[1]


async def test_a_pod_nobody_decided_about_is_404(site: tuple[Site, str]) -> None:
    _, url = site
    assert (await get(f"{url}/explain/team-b/p"))[0] == 404
