"""The page that says why pods are where they are: records in words, pods' own words without them, and whose rights count."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import msgspec
from aiohttp import web
from tests.unit.console.guarded_api import ADMIN, APPS, PODS, TENANT, Browser, Stage, staged
from tests.unit.console.objects import Object, app

from robotapp_console.cluster.scheduler_port import SchedulerPort
from robotapp_console.views.app.reasons import MOST_REASONS, ReasonRow, build_reasons, list_without_pods, select_pods
from robotapp_console.views.objects import AppPod
from robotapp_scheduler.core.explain.record import Example, Record, Refusal, Top, as_json

PAGE = "/apps/team-a/teleop/why"
SPEC: Object = {
    "components": [{"name": "driver"}, {"name": "planner"}],
    "edges": [{"topic": "/odom", "from": "driver", "to": "planner", "latency": {"budget": "30ms"}}],
}


def pod(
    name: str, component: str, *, node: str = "", robot: str = "amr-07", message: str = "", **annotations: str
) -> Object:
    labels = {"robotics.io/app-uid": "u-1", "robotics.io/component": component, "robotics.io/instance": robot}
    condition = {"type": "PodScheduled", "status": "False", "reason": "Unschedulable", "message": message}
    return {
        "metadata": {
            "name": name,
            "namespace": "team-a",
            "labels": labels,
            "annotations": {f"robotics.io/{key.replace('_', '-')}": value for key, value in annotations.items()},
        },
        "spec": {"nodeName": node},
        "status": {"conditions": [condition]},
    }


def record(*refusals: Refusal, node: str | None = "edge-1", **fields: Any) -> dict[str, Any]:
    needed = {"namespace": "n", "name": "p", "uid": "u", "at_s": 1.0, "profile": "x", "config_hash": "y", "attempt": 1}
    whole = {"message": "", "nodes": 5, "feasible": 1, "refusals": refusals, "node": node} | needed | fields
    return as_json(Record(**whole))  # type: ignore[arg-type]


LATE = Refusal("LatencyFilter", "node(s) exceeded the latency budget", 1, "ms", (Example("cloud-1", 61.04),))


def rows_of(*pods: Object, records: dict[str, dict[str, Any]] | None = None) -> tuple[ReasonRow, ...]:
    chosen = select_pods([msgspec.convert(item, AppPod) for item in pods], "amr-07")
    return build_reasons({"spec": SPEC}, chosen, records or {}, robot="amr-07")


def test_a_record_gives_runner_up_refused_nodes_scores_and_notes() -> None:
    top = Top(nodes=("edge-1", "edge-2"), totals=(90, 70))
    decision = record(LATE, runner_up="edge-2", top=top, tier="Edge comes before Cloud", devices=("can0",))
    (_, row) = rows_of(pod("a", "driver", node="amr-07"), pod("b", "planner", node="edge-1"), records={"b": decision})
    assert (row.component, row.node, row.runner_up) == ("planner", "edge-1", "edge-2")
    assert row.refused == ("cloud-1: 61.0 ms to amr-07 > 30 ms",)
    assert row.scores == (("edge-1", 90), ("edge-2", 70))
    assert row.notes == ("Edge comes before Cloud", "holds can0")


def test_without_a_record_a_waiting_pod_has_its_conditions_words() -> None:
    (row, other) = rows_of(
        pod("a", "driver", message="0/5 nodes are available: 5 Insufficient cpu."), pod("b", "planner")
    )
    assert row.refused == ("0/5 nodes are available: 5 Insufficient cpu.",)
    assert other.refused == ("the scheduler has not looked at it yet",)
    assert not row.is_recorded


def test_a_component_without_a_pod_is_named() -> None:
    pods = select_pods([msgspec.convert(pod("a", "driver"), AppPod)], "amr-07")
    assert list_without_pods({"spec": SPEC}, pods) == ("planner",)
    numbered = {"components": [{"name": "det", "replicas": 2, "replicaIdentity": "Ordinal"}]}
    pods = select_pods([msgspec.convert(pod("a", "det-1"), AppPod)], "amr-07")
    assert list_without_pods({"spec": numbered}, pods) == ("det-0",)


def test_what_was_given_up_and_what_is_proposed_are_notes() -> None:
    given_up = (
        '{"edges": [{"edge": "/image", "peer": "detector", "budget": "30ms", "time": "42ms", "source": "measured", '
        '"nodes": ["edge-1", "edge-2"]}], "tier": "Robot", "insteadOf": ["Edge"]}'
    )
    better = '{"node": "edge-2", "edge": "/odom to driver", "before": "61ms", "after": "8ms", "expires": "2099-01-02T03:04:05Z"}'
    (row,) = rows_of(pod("a", "driver", node="edge-1", fallback=given_up, better_node=better))
    assert row.notes == (
        "gave up /image to detector: 42ms (measured) is over the Preferred budget of 30ms",
        "runs on tier Robot instead of Edge",
        "edge-2 is proposed: /odom to driver 61ms here, 8ms there",
    )
    (broken,) = rows_of(pod("a", "driver", node="edge-1", fallback="<b>", better_node="{}"))
    assert len(broken.notes) == 2


def test_many_reasons_are_cut_and_counted() -> None:
    refusals = tuple(Refusal("NodeResourcesFit", f"reason {i}", 1) for i in range(30))
    (row,) = rows_of(pod("a", "driver", node="x"), records={"a": record(*refusals)})
    assert len(row.refused) == MOST_REASONS
    assert row.refused[-1] == f"and {30 - MOST_REASONS + 1} more"


def test_only_pods_of_the_instance_are_shown_by_component() -> None:
    rows = rows_of(pod("z", "driver"), pod("b", "planner"), pod("a", "planner"), pod("x", "driver", robot="amr-08"))
    assert [row.pod for row in rows] == ["z", "a", "b"]


@asynccontextmanager
async def scheduler(stage: Stage, answers: dict[str, tuple[int, Any]]) -> AsyncIterator[list[str]]:
    """A scheduler's port that gives these answers by pod, and collects the Authorization headers of who asks."""
    headers: list[str] = []

    async def explain(request: web.Request) -> web.Response:
        headers.append(request.headers.get("Authorization", ""))
        status, body = answers.get(request.match_info["pod"], (404, {"error": "no decision is known"}))
        return web.json_response(body, status=status)

    application = web.Application()
    application.router.add_get("/explain/{namespace}/{pod}", explain)
    runner = web.AppRunner(application)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    stage.console.scheduler = SchedulerPort(f"http://127.0.0.1:{runner.addresses[0][1]}")
    try:
        yield headers
    finally:
        await runner.cleanup()


async def fill(stage: Stage, token: str = TENANT) -> Browser:
    body = app("teleop", namespace="team-a")
    body["spec"] = SPEC
    uid = stage.api.put(APPS, body)["metadata"]["uid"]
    for item in (pod("a", "driver", node="amr-07"), pod("b", "planner", message="5 Insufficient cpu.")):
        item["metadata"]["labels"]["robotics.io/app-uid"] = uid
        stage.api.put(PODS, item)
    browser = stage.browser()
    await browser.sign_in(token, home="team-a")
    return browser


async def test_the_scheduler_is_asked_with_the_users_token_and_its_decisions_are_shown() -> None:
    async with staged() as stage, scheduler(stage, {"a": (200, record(LATE, runner_up="edge-2"))}) as headers:
        page = await (await fill(stage)).get(f"{PAGE}?robot=amr-07")
        assert page.status == 200
        for text in ("edge-2", "cloud-1: 61.0 ms to ", "5 Insufficient cpu.", "Why here?"):
            assert text in page.text
        assert set(headers) == {f"Bearer {TENANT}"}
        assert TENANT not in page.text


async def test_without_a_way_to_the_scheduler_pods_speak_for_themselves_and_the_command_is_there() -> None:
    async with staged() as stage:
        page = await (await fill(stage)).get(PAGE)
        assert page.status == 200
        assert "Not shown: the scheduler's decisions." in page.text
        assert "5 Insufficient cpu." in page.text
        assert "kubectl robotapp explain teleop -n team-a --robot amr-07" in page.text


async def test_what_the_operator_says_of_an_instance_in_trouble_stands_above() -> None:
    held = "device can0 on amr-07 is held by team-b/other"
    async with staged() as stage:
        body = app(
            "teleop", namespace="team-a", troubled=[{"instance": "amr-07", "reason": "DeviceBusy", "message": held}]
        )
        stage.api.put(APPS, body)
        browser = stage.browser()
        await browser.sign_in(TENANT, home="team-a")
        assert held in (await browser.get(f"{PAGE}?robot=amr-07")).text
        assert held not in (await browser.get(f"{PAGE}?robot=amr-08")).text


async def test_all_pods_are_asked_about_through_one_tunnel_that_ends() -> None:
    openings: list[str] = []

    @asynccontextmanager
    async def tunnel() -> AsyncIterator[int]:
        openings.append("opened")
        yield 1
        openings.append("closed")

    async with staged() as stage:
        stage.console.scheduler = SchedulerPort(tunnel=tunnel)
        page = await (await fill(stage)).get(PAGE)
        assert "The scheduler at https://127.0.0.1:1 does not answer" in page.text
        assert openings == ["opened", "closed"]


async def test_a_refusal_of_the_scheduler_is_told_and_it_is_not_asked_again() -> None:
    refusal = (403, {"error": "you may not get pods in namespace team-a"})
    async with staged() as stage, scheduler(stage, dict.fromkeys("ab", refusal)) as headers:
        page = await (await fill(stage)).get(PAGE)
        assert "you may not get pods in namespace team-a" in page.text
        assert len(headers) <= 2


async def test_who_may_not_read_the_pods_or_the_app_is_told_so() -> None:
    async with staged() as stage:
        browser = await fill(stage, ADMIN)
        stage.api.forbidden = {"pods"}
        page = await browser.get(PAGE)
        assert page.status == 403
        assert "Not shown: pods of the app" in page.text
        assert (await browser.get("/apps/team-a/none/why")).status == 404
        assert (await browser.get("/apps/team-a/..%2Fx/why")).status in (400, 404)
