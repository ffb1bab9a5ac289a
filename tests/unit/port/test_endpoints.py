"""The port's pages: what each user may see, how often, and the texts of refusals."""

import asyncio
import io
import json
from collections.abc import AsyncIterator, Mapping
from typing import Any

import aiohttp
import msgspec
import pytest
from prometheus_client import CollectorRegistry
from tests.support.clients import until
from tests.support.scheduling import Clock

from robotapp_api.model.names import API_VERSION
from robotapp_client.serving.access import Access, Caller
from robotapp_client.serving.port import open_port
from robotapp_client.transport.errors import Unreachable
from robotapp_scheduler.config.load import built_in
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.port.endpoints import DECIDE_AT_ONCE, DECIDE_PER_S, Endpoints, application
from robotapp_scheduler.port.frames import NOT_RECORDED, Request, Response
from robotapp_scheduler.port.pages import Checks, pages, simulation_config
from robotapp_scheduler.port.simulate import Simulator
from robotapp_scheduler.shell.config.reload import Running
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.what_if.question import MOST_BODY


class Site:
    """The port with switches for everything it asks."""

    def __init__(self) -> None:
        self.ready = True
        self.live = True
        self.answer: Access | Exception = Access.ALL
        self.checked: list[tuple[str, str]] = []
        self.remembered = True
        self.decided = 0
        self.simulated: list[int] = []
        self.tried: list[Request] = []
        self.open = asyncio.Event()
        self.open.set()
        self.only = ""
        """The one namespace whose pods a user may get; "" = what `answer` says for all."""
        self.clock = Clock()
        self.metrics = Metrics(CollectorRegistry())
        running = Running(built_in(catalogue()))
        checks = Checks(ready={"informers-sync": lambda: self.ready}, live={"leader-election": lambda: self.live})
        self.pages = pages(checks, self.metrics.registry, running)

        async def given() -> Mapping[str, Any]:
            return simulation_config(running)

        endpoints = Endpoints(gate=self, scheduler=self, simulator=Simulator(given), clock=self.clock)
        self.application = application(self, endpoints)

    async def page(self, what: str) -> Response:
        return Response(0, *self.pages[what]())

    async def request(self, request: Request) -> Response:
        if request.what == "simulated":
            self.simulated.append(request.status)
            return Response(0, 200, b"")
        if request.what == "what-if":
            self.tried.append(request)
            await self.open.wait()
            return Response(0, 200, b"{}")
        self.decided += request.what == "decide"
        if request.namespace != "team-a":
            return Response(0, 404, b"")
        if request.what == "explain" and not self.remembered:
            return Response(0, NOT_RECORDED, b"")
        found = {"pod": request.pod, "nodes": request.with_nodes} | ({"full": True} if request.full else {})
        return Response(0, 200, msgspec.json.encode(found))

    async def access(self, caller: Caller, namespace: str) -> Access:
        self.checked.append((caller.token, namespace))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer if self.only in ("", namespace) else Access.FORBIDDEN

    async def path(self, caller: Caller, verb: str, path: str) -> Access:
        return await self.access(caller, f"{verb} {path}")

    def user_of(self, caller: Caller) -> str:
        return caller.token[:3]


@pytest.fixture
async def site() -> AsyncIterator[tuple[Site, str]]:
    found = Site()
    port = await open_port(found.application, host="127.0.0.1", port=0, tls=None)
    yield found, f"http://127.0.0.1:{port.number}"
    await port.close()


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
    found.metrics.attempt_s.labels("scheduled", "ours").observe(0.01)
    found.metrics.sli_s.labels("1").observe(0.02)
    found.metrics.watch("pending_pods", "Waiting pods", label="queue", read=lambda: {"active": 3})
    status, text = await get(f"{url}/metrics")
    assert status == 200
    assert 'scheduler_schedule_attempts_total{profile="ours",result="scheduled"} 1.0' in text
    assert 'scheduler_pod_scheduling_sli_duration_seconds_bucket{attempts="1",le="0.02"} 1.0' in text
    assert 'scheduler_pending_pods{queue="active"} 3.0' in text


async def test_metrics_are_for_who_may_get_the_path_and_health_is_for_everybody(site: tuple[Site, str]) -> None:
    found, url = site
    assert (await get(f"{url}/metrics", Authorization="Bearer t1"))[0] == 200
    assert found.checked == [("t1", "get /metrics")]
    for access, status, text in ((Access.FORBIDDEN, 403, "get /metrics"), (Access.UNKNOWN_CALLER, 401, "bearer token")):
        found.answer = access
        answer = await get(f"{url}/metrics")
        assert answer[0] == status
        assert text in answer[1]
        assert "scheduler_" not in answer[1]
        for path in ("livez", "healthz", "readyz"):
            assert await get(f"{url}/{path}") == (200, "ok")


async def test_configz_shows_what_the_process_runs_with_to_who_may_get_it(site: tuple[Site, str]) -> None:
    found, url = site
    assert '"schedulerName":"ros-aware-scheduler"' in (await get(f"{url}/configz", Authorization="Bearer t1"))[1]
    assert found.checked == [("t1", "get /configz")]
    for access, status in ((Access.FORBIDDEN, 403), (Access.UNKNOWN_CALLER, 401)):
        found.answer = access
        assert (await get(f"{url}/configz"))[0] == status


async def test_the_full_table_is_asked_for_by_a_parameter(site: tuple[Site, str]) -> None:
    _, url = site
    assert '"full":true' in (await get(f"{url}/explain/team-a/p?full=1"))[1]


async def test_a_user_has_few_decisions_made_again_whichever_token_it_brings_and_others_theirs(
    site: tuple[Site, str],
) -> None:
    """Each is a copy of the process that places pods: 50 a second would be most of what it does."""
    found, url = site
    found.remembered = False
    for number in range(DECIDE_AT_ONCE):
        assert (await get(f"{url}/explain/team-a/p?full=1", Authorization=f"Bearer eve{number}"))[0] == 200
    for path in ("explain/team-a/p?full=1", "explain/team-a/p"):
        async with aiohttp.ClientSession() as session:
            answer = await session.get(f"{url}/{path}", headers={"Authorization": "Bearer eve"})
            assert (answer.status, answer.headers["Retry-After"]) == (429, str(int(1 / DECIDE_PER_S)))
            assert "too often" in json.loads(await answer.text())["error"]
    assert found.decided == DECIDE_AT_ONCE
    assert (await get(f"{url}/explain/team-a/p?full=1", Authorization="Bearer amy"))[0] == 200
    found.clock.forward(1 / DECIDE_PER_S)
    assert (await get(f"{url}/explain/team-a/p?full=1", Authorization="Bearer eve"))[0] == 200
    found.remembered = True
    assert (await get(f"{url}/explain/team-a/p", Authorization="Bearer eve"))[0] == 200


async def test_explain_passes_the_bearer_token_and_hides_nodes_from_who_may_not_get_them(
    site: tuple[Site, str],
) -> None:
    found, url = site
    assert await get(f"{url}/explain/team-a/p", Authorization="Bearer t1") == (200, '{"pod":"p","nodes":true}')
    found.answer = Access.WITHOUT_NODES
    assert (await get(f"{url}/explain/team-a/p", Authorization="Bearer t1"))[1] == '{"pod":"p","nodes":false}'
    assert found.checked == [("t1", "team-a")] * 2


@pytest.mark.parametrize(
    ("access", "status", "text"),
    [
        (Access.UNKNOWN_CALLER, 401, "bearer token"),
        (Access.FORBIDDEN, 403, "may not get pods in namespace team-a: ClusterRole view may"),
        (Unreachable("down", maybe_applied=False), 503, "cannot say who you are"),
    ],
)
async def test_explain_refuses_with_a_reason(
    site: tuple[Site, str], access: Access | Exception, status: int, text: str
) -> None:
    found, url = site
    found.answer = access
    answer = await get(f"{url}/explain/team-a/p")
    assert answer[0] == status
    assert text in answer[1]


async def test_a_token_that_is_not_taken_is_told_apart_from_none(site: tuple[Site, str]) -> None:
    found, url = site
    found.answer = Access.UNKNOWN_CALLER
    for page in ("explain/team-a/p", "metrics"):
        assert "has expired" in (await get(f"{url}/{page}", Authorization="Bearer old"))[1]
        assert "has expired" not in (await get(f"{url}/{page}"))[1]


@pytest.mark.parametrize("path", ["", "explain", "explain/team-a", "metric"])
async def test_a_path_that_is_not_served_is_answered_with_those_that_are(site: tuple[Site, str], path: str) -> None:
    _, url = site
    status, text = await get(f"{url}/{path}")
    assert status == 404
    assert f"nothing is served at GET /{path}; there are /configz, /explain/{{namespace}}/{{pod}}, /healthz" in text


async def test_a_pod_nobody_decided_about_is_404(site: tuple[Site, str]) -> None:
    _, url = site
    assert (await get(f"{url}/explain/team-b/p"))[0] == 404


async def post(url: str, body: bytes) -> tuple[int, str]:
    async with aiohttp.ClientSession() as session, session.post(url, data=io.BytesIO(body)) as response:
        return response.status, await response.text()


async def test_simulate_is_for_who_may_post_it_and_tells_which_kinds_it_wants(site: tuple[Site, str]) -> None:
    found, url = site
    assert (await post(f"{url}/simulate", b'{"kind":"List","items":[]}'))[0] == 200
    assert '"plural":"nodes"' in (await get(f"{url}/simulate"))[1]
    assert [question for _, question in found.checked] == ["post /simulate", "get /simulate"]
    assert found.simulated == [200]
    assert (await post(f"{url}/simulate?replay=many", b""))[0] == 400
    found.answer = Access.FORBIDDEN
    assert (await post(f"{url}/simulate", b"{}"))[0] == 403
    assert (await get(f"{url}/simulate"))[0] == 403


# --- What-if ------------------------------------------------------------------------------------------------------------

LOSS = b'{"nodeLoss": ["n1"]}'


def tried_app(namespace: str) -> bytes:
    meta = {"name": "a", "namespace": namespace}
    return json.dumps({"apps": [{"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": meta}]}).encode()


async def test_who_may_get_all_pods_and_nodes_is_shown_all_of_what_would_be(site: tuple[Site, str]) -> None:
    found, url = site
    assert (await post(f"{url}/what-if?namespace=team-a", LOSS))[0] == 200
    assert found.tried == [Request("what-if", namespace="", with_nodes=True, body=LOSS)]
    assert found.checked == [("", "")]


async def test_who_may_get_the_pods_of_one_namespace_is_shown_these(site: tuple[Site, str]) -> None:
    found, url = site
    found.only = "team-a"
    assert (await post(f"{url}/what-if?namespace=team-a", LOSS))[0] == 200
    assert found.tried[0].namespace == "team-a"
    for query, text in (("", "name one: ?namespace="), ("?namespace=team-b", "may not get pods in namespace team-b")):
        status, answer = await post(f"{url}/what-if{query}", LOSS)
        assert (status, text in answer) == (403, True)
    assert (await post(f"{url}/what-if?namespace=team-a", tried_app("team-a")))[0] == 200
    status, answer = await post(f"{url}/what-if?namespace=team-a", tried_app("team-b"))
    assert (status, "RobotApp team-b/a" in answer) == (403, True)
    assert len(found.tried) == 2


async def test_to_name_nodes_takes_the_right_to_get_nodes(site: tuple[Site, str]) -> None:
    found, url = site
    found.answer = Access.WITHOUT_NODES
    status, answer = await post(f"{url}/what-if?namespace=team-a", LOSS)
    assert (status, "you may not get nodes" in answer) == (403, True)
    assert (await post(f"{url}/what-if?namespace=team-a", tried_app("team-a")))[0] == 200
    assert [request.with_nodes for request in found.tried] == [False]


async def test_a_configuration_to_try_takes_the_right_to_simulate(site: tuple[Site, str]) -> None:
    found, url = site
    assert (await post(f"{url}/what-if", b'{"config": {"kind": "x"}}'))[0] == 200
    assert found.checked[-1] == ("", "post /simulate")
    found.only = "team-a"
    assert (await post(f"{url}/what-if?namespace=team-a", b'{"config": {"kind": "x"}}'))[0] == 403


async def test_a_bad_or_endless_question_never_reaches_the_process_that_places_pods(site: tuple[Site, str]) -> None:
    found, url = site
    for body, refusal, text in (
        (b"", 400, "nodeLoss"),
        (b'{"rtt": [{"one": "a", "other": "b", "rtt": "soon"}]}', 400, "'soon' is not a duration"),
        (b" " * (MOST_BODY + 1), 413, "more than 1 MiB"),
    ):
        status, answer = await post(f"{url}/what-if", body)
        assert (status, text in json.loads(answer)["error"]) == (refusal, True)
    found.answer = Access.UNKNOWN_CALLER
    assert (await post(f"{url}/what-if", LOSS))[0] == 401
    found.answer = Unreachable("down", maybe_applied=False)
    assert (await post(f"{url}/what-if", LOSS))[0] == 503
    assert found.tried == []


async def test_what_if_and_decisions_made_again_are_counted_together_per_user(site: tuple[Site, str]) -> None:
    found, url = site
    for _ in range(DECIDE_AT_ONCE):
        assert (await post(f"{url}/what-if", LOSS))[0] == 200
    assert (await post(f"{url}/what-if", LOSS))[0] == 429
    assert len(found.tried) == DECIDE_AT_ONCE


async def test_a_user_takes_one_place_in_the_line_however_many_questions_it_sends(site: tuple[Site, str]) -> None:
    found, url = site
    found.open.clear()
    first = asyncio.create_task(post(f"{url}/what-if", LOSS))
    await until(lambda: bool(found.tried))
    status, answer = await post(f"{url}/what-if", LOSS)
    assert (status, "another question of yours" in answer) == (429, True)
    found.open.set()
    assert (await first)[0] == 200
    assert (await post(f"{url}/what-if", LOSS))[0] == 200
    assert (await post(f"{url}/what-if", b"{"))[0] == 400
    assert (await post(f"{url}/what-if", LOSS))[0] == 200, "one that was refused is no longer under way"


async def test_bad_questions_count_too(site: tuple[Site, str]) -> None:
    found, url = site
    statuses = [(await post(f"{url}/what-if", b"{"))[0] for _ in range(DECIDE_AT_ONCE + 1)]
    assert statuses == [400] * DECIDE_AT_ONCE + [429]
    assert found.tried == []
