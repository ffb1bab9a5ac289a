"""The screen of the scheduler, in front of an API server with tokens and rights and of a scheduler's port."""

import json
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any
from urllib.parse import unquote, urlsplit

import msgspec
import pytest
from aiohttp import web
from tests.support.apiserver import verbs
from tests.support.apiserver.wire import TypedConnection
from tests.unit.console import guarded_api
from tests.unit.console.guarded_api import ADMIN, EVENTS, NODES, Browser, GuardedApi, Page, Stage, staged
from tests.unit.console.objects import node
from tests.unit.console.tuning.documents import build_text

from robotapp_client.tools.scheduler_tunnel import NoTunnelError
from robotapp_console.cluster import config_store
from robotapp_console.cluster.scheduler_port import SchedulerPort
from robotapp_console.tuning.form import build_form, fill_form
from robotapp_scheduler.config.editing import read_document

TEXT = build_text()
NAMESPACE, NAME = "robotapp-system", "robotapp-scheduler"
HOSTILE = "<script>alert(1)</script>\u202e"


class ConfigApi(GuardedApi):
    """Answers reviews of access as well; `denied` are names of ConfigMaps that nobody may patch."""

    def __init__(self) -> None:
        super().__init__()
        self.denied: set[str] = set()

    def answer(self, client: TypedConnection, method: str, url: str, body: bytes) -> None:
        where = verbs.target(unquote(urlsplit(url).path))
        if where.plural == "selfsubjectaccessreviews":
            name = msgspec.json.decode(body)["spec"]["resourceAttributes"]["name"]
            client.reply(201, msgspec.json.encode({"status": {"allowed": name not in self.denied}}))
            return
        if method == "PATCH" and where.name in self.denied:
            refusal = guarded_api.Refused(403, "Forbidden", f'User cannot patch configmap "{where.name}"')
            client.reply(403, msgspec.json.encode(refusal.status()))
            return
        super().answer(client, method, url, body)

    def put_map(self, name: str, **data: str) -> None:
        self.put("/configmaps", {"metadata": {"name": name, "namespace": NAMESPACE}, "data": data})

    def read_text(self) -> str:
        (config,) = [
            found for found in self.store.select("/configmaps", NAMESPACE) if found["metadata"]["name"] == NAME
        ]
        return str(config["data"]["scheduler.yaml"])


@asynccontextmanager
async def opened(
    monkeypatch: pytest.MonkeyPatch, *, text: str = TEXT, running: str | None = None
) -> AsyncIterator[Stage]:
    """A console whose API server has the three ConfigMaps; the scheduler runs with `running`, or with the text."""
    monkeypatch.setattr(guarded_api, "GuardedApi", ConfigApi)
    monkeypatch.setattr(config_store, "RELOAD_S", 0.1)
    async with staged() as stage:
        api = stage.api
        assert isinstance(api, ConfigApi)
        api.put_map(NAME, **{"scheduler.yaml": text})
        api.put_map(f"{NAME}-last-good", **{"scheduler.yaml": text if running is None else running})
        api.put_map(f"{NAME}-history")
        yield stage


async def signed_in(stage: Stage) -> Browser:
    browser = stage.browser()
    await browser.sign_in(ADMIN)
    return browser


def fill(page: Page, **changes: str) -> dict[str, str]:
    """The fields of the page's form, with these changes."""
    base = page.field("base").replace("&#39;", "'").replace("&lt;", "<")
    hidden = {name: page.field(name) for name in ("csrf", "version", "complete")}
    fields = fill_form(build_form(read_document(base)))
    return fields | hidden | {"base": base} | {name.replace("__", "-"): value for name, value in changes.items()}


def api_of(stage: Stage) -> ConfigApi:
    assert isinstance(stage.api, ConfigApi)
    return stage.api


async def test_the_form_shows_profiles_plugins_weights_arguments_and_that_it_is_in_use(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with opened(monkeypatch) as stage:
        page = await (await signed_in(stage)).get("/scheduler")
        assert page.status == 200
        assert 'data-state="running"' in page.text
        for text in ("ros-aware-scheduler", "kubernetes-scheduler", 'id="p0-score-TopologyScore" name='):
            assert text in page.text
        assert re.search(r'id="p1-weight-TopologyScore"[^>]* value="25"', page.text)
        assert re.search(r'id="p0-arg-LatencyFilter-maxLatency"[^>]* value="100ms"', page.text)
        assert "accepted and ignored" in page.text
        assert 'id="apply"' in page.text


async def test_a_preview_marks_changed_lines_and_names_mistakes_without_writing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        answer = await browser.post("/scheduler", fill(page, p0__weight__TopologyScore="10"), HX_Request="true")
        assert answer.status == 200
        assert "<html" not in answer.text
        assert re.search(r'<code class="added">.*weight: 10', answer.text)
        wrong = await browser.post("/scheduler", fill(page, p0__arg__LatencyFilter__maxLatency="soon"))
        assert "<html" in wrong.text
        assert 'data-problem-of="p0-arg-LatencyFilter-maxLatency"' in wrong.text
        assert re.search(r'id="p0-arg-LatencyFilter-maxLatency"[^>]* aria-invalid="true"', wrong.text)
        refused = await browser.post("/scheduler", fill(wrong, action="apply"))
        assert refused.status == 422
        assert api_of(stage).read_text() == TEXT


async def test_a_text_that_cannot_be_read_has_no_fields_and_is_not_what_the_scheduler_runs_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        answer = await browser.post("/scheduler", fill(page, text="{{{", action="text"))
        assert f"The scheduler runs with ConfigMap robotapp-system/{NAME}" in answer.text
        assert "The fields above" not in answer.text
        assert "The fields come back when this text can be read." in answer.text


async def test_apply_writes_as_the_user_records_the_version_and_undo_takes_it_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        applied = await browser.post(
            "/scheduler", fill(page, p0__weight__TopologyScore="10", p0__weight__LatencyScore="40", action="apply")
        )
        assert (applied.status, applied.headers["Location"]) == (303, "/scheduler?applied=1")
        assert "weight: 40" in api_of(stage).read_text()
        waiting = await browser.get("/scheduler?applied=1")
        assert 'data-state="waiting"' in waiting.text
        api_of(stage).put_map(f"{NAME}-last-good", **{"scheduler.yaml": api_of(stage).read_text()})
        after = await browser.get("/scheduler")
        assert 'data-state="running"' in after.text
        assert "Undo: back to version 1" in after.text
        assert re.search(r'data-label="By">admin<', after.text)
        undone = await browser.post(
            "/scheduler", {"csrf": after.field("csrf"), "version": after.field("version"), "action": "undo"}
        )
        assert undone.status == 303
        assert api_of(stage).read_text() == TEXT


async def test_a_version_is_opened_and_nothing_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        await browser.post("/scheduler", fill(page, p0__weight__TopologyScore="10", action="apply"))
        page = await browser.get("/scheduler")
        fields = {"csrf": page.field("csrf"), "action": "restore", "number": "1"}
        older = await browser.post("/scheduler", fields)
        assert "This is version 1. Nothing is written until you apply it." in older.text
        assert "weight: 10" in api_of(stage).read_text()
        gone = await browser.post("/scheduler", fields | {"number": "99"})
        assert "not kept any more" in gone.text


async def test_a_change_of_somebody_else_is_not_overwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        api_of(stage).put_map(NAME, **{"scheduler.yaml": TEXT + "podMaxBackoffSeconds: 20\n"})
        answer = await browser.post("/scheduler", fill(page, p0__weight__TopologyScore="10", action="apply"))
        assert answer.status == 409
        assert "Somebody else changed the configuration" in answer.text
        assert "podMaxBackoffSeconds: 20" in api_of(stage).read_text()
        stale = {"csrf": page.field("csrf"), "version": page.field("version"), "action": "undo"}
        assert (await browser.post("/scheduler", stale)).status == 409


async def test_a_version_that_cannot_be_recorded_is_told_and_nothing_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        await browser.post("/scheduler", fill(page, p0__weight__TopologyScore="10", action="apply"))
        page = await browser.get("/scheduler")
        api_of(stage).denied = {f"{NAME}-history"}
        answer = await browser.post("/scheduler", fill(page, p0__weight__TopologyScore="11", action="apply"))
        assert answer.status == 502
        assert "Applied, but not recorded among the versions" in answer.text
        assert "weight: 11" in api_of(stage).read_text()
        api_of(stage).denied = set()
        assert "Undo: back to version 2" in (await browser.get("/scheduler")).text


async def test_where_the_history_cannot_be_written_what_is_not_in_it_is_not_replaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        api_of(stage).denied = {f"{NAME}-history"}
        answer = await browser.post("/scheduler", fill(page, p0__weight__TopologyScore="10", action="apply"))
        assert answer.status == 403
        assert api_of(stage).read_text() == TEXT


async def test_without_rights_the_screen_is_read_only_and_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        api_of(stage).denied = {NAME}
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        assert 'id="read-only"' in page.text
        assert "robotapp-scheduler-tuner" in page.text
        assert 'id="apply"' not in page.text
        assert 'id="undo"' not in page.text
        assert (
            await browser.post("/scheduler", fill(page, p0__weight__TopologyScore="10", action="apply"))
        ).status == 403
        assert api_of(stage).read_text() == TEXT


async def test_who_may_not_read_it_and_a_cluster_without_it_get_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        api_of(stage).forbidden = {"configmaps"}
        page = await browser.get("/scheduler")
        assert page.status == 200
        assert "No configuration can be shown" in page.text
        assert "robotapp-scheduler-tuner" in page.text
        api_of(stage).forbidden = set()
        api_of(stage).remove("/configmaps", NAME, NAMESPACE)
        page = await browser.get("/scheduler")
        assert "There is no ConfigMap" in page.text
        assert "--scheduler-config NAMESPACE/NAME" in page.text
        assert "robotapp-scheduler-tuner" not in page.text, "no right would help"


async def test_a_refusal_of_the_scheduler_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch, running=TEXT + "podMaxBackoffSeconds: 20\n") as stage:
        browser = await signed_in(stage)
        assert 'data-state="waiting"' in (await browser.get("/scheduler")).text
        (config,) = [
            found for found in api_of(stage).store.select("/configmaps", NAMESPACE) if found["metadata"]["name"] == NAME
        ]
        event = {
            "metadata": {"name": "refused", "namespace": NAMESPACE},
            "regarding": {"uid": config["metadata"]["uid"]},
            "reason": "ConfigInvalid",
            "note": f"cannot be used: {HOSTILE}",
            "eventTime": "2099-01-01T00:00:00Z",
        }
        api_of(stage).put(EVENTS, event)
        page = await browser.get("/scheduler")
        assert 'data-state="refused"' in page.text
        assert "<script>alert" not in page.text
        assert "&lt;script&gt;" in page.text


async def test_a_button_that_the_page_does_not_have_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        answer = await browser.post("/scheduler", fill(await browser.get("/scheduler"), action="dance"))
        assert (answer.status, "no button for" in answer.text) == (400, True)


async def test_a_form_that_arrives_incomplete_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        fields = fill(await browser.get("/scheduler"), action="apply")
        del fields["complete"]
        answer = await browser.post("/scheduler", fields)
        assert answer.status == 400
        assert "incomplete" in answer.text


async def test_writes_need_the_csrf_token_and_a_page_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        fields = fill(await browser.get("/scheduler"), p0__weight__TopologyScore="10", action="apply")
        for path in ("/scheduler", "/api/config"):
            assert (await browser.post(path, fields | {"csrf": "x"})).status == 403
            assert (await browser.post(path, fields, Origin="https://evil.example")).status == 403
            assert (await stage.browser().post(path, fields)).status in (401, 403)
        assert api_of(stage).read_text() == TEXT
        for path in ("/scheduler", "/api/config", "/api/nodes"):
            assert (await stage.browser().get(path)).status == 303


async def test_hostile_texts_of_the_configuration_are_text(monkeypatch: pytest.MonkeyPatch) -> None:
    hostile = build_text(pluginConfig=[{"name": HOSTILE, "args": {HOSTILE: HOSTILE}}])
    for text in (hostile, TEXT.replace("ros-aware-scheduler", HOSTILE), HOSTILE, f"# {HOSTILE}\n{TEXT}"):
        async with opened(monkeypatch, text=text) as stage:
            browser = await signed_in(stage)
            page = await browser.get("/scheduler")
            assert page.status == 200
            assert "<script>alert" not in page.text
            api_of(stage).put_map(
                f"{NAME}-history", **{"version-000001": json.dumps({"at": HOSTILE, "by": HOSTILE, "text": ""})}
            )
            assert "<script>alert" not in (await browser.get("/scheduler")).text


@asynccontextmanager
async def scheduler_port(answer: dict[str, Any], status: int = 200) -> AsyncIterator[tuple[str, list[Any]]]:
    """Where a scheduler answers what-if, and what it was asked."""
    asked: list[Any] = []

    async def what_if(request: web.Request) -> web.Response:
        asked.append((request.headers.get("Authorization"), request.query.get("namespace"), await request.json()))
        return web.json_response(answer, status=status)

    app = web.Application()
    app.router.add_post("/what-if", what_if)
    runner = web.AppRunner(app)
    await runner.setup()
    try:
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        yield f"http://127.0.0.1:{runner.addresses[0][1]}", asked
    finally:
        await runner.cleanup()


MOVED = {"namespace": "team-a", "pod": "cam-1", "app": "cam", "component": "c", "outcome": "MayMove", "from": "edge-1",
         "to": "edge-2", "reason": f"40 points against 20 {HOSTILE}"}  # fmt: skip
EDGE = {"namespace": "team-a", "app": "cam", "instance": "amr-07", "edge": "/image", "from": "c", "to": "d", "budgetMs": 30,
        "percentile": 95, "before": {"rttMs": 10, "source": "measured", "verdict": "Met"},
        "after": {"rttMs": None, "source": "measured", "verdict": "Exceeded"}}  # fmt: skip


async def test_a_replay_lists_the_pods_that_would_sit_elsewhere_with_the_users_token(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answer = {"pods": [MOVED], "edges": [EDGE], "replayed": 7, "notes": ["note"], "hidden": {"pods": 2, "edges": 0}}
    async with opened(monkeypatch) as stage, scheduler_port(answer) as (url, asked):
        stage.console.scheduler = SchedulerPort(url)
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        fields = fill(page, p0__weight__TopologyScore="10", action="replay", replay="50")
        result = await browser.post("/scheduler", fields)
        assert 'data-judged="7" data-moved="1"' in result.text
        for text in (
            "team-a/cam-1",
            "edge-2",
            "40 points against 20",
            "30 ms p95",
            "Exceeded (no answer)",
            "2 more pods",
        ):
            assert text in result.text
        assert "<script>alert" not in result.text
        ((token, _, question),) = asked
        assert token == f"Bearer {ADMIN}"
        assert question["replay"] == 50
        assert question["config"]["profiles"][0]["plugins"]["score"]["enabled"] == [
            {"name": "TopologyScore", "weight": 10}
        ]
        assert re.search(r'id="p0-weight-TopologyScore"[^>]* value="10"', result.text), "the draft is kept"
        assert api_of(stage).read_text() == TEXT


@pytest.mark.parametrize(
    ("status", "answer", "words"),
    [
        (403, {"error": "you may not post /simulate"}, "robotapp-cluster-viewer"),
        (429, {"error": "many decisions"}, "Ask again in some seconds"),
        (404, {}, "older than the console"),
        (400, {"error": "the configuration cannot be used", "problems": ["x: wrong"]}, "x: wrong"),
        (500, {}, "no reason was given"),
    ],
)
async def test_a_scheduler_that_refuses_is_quoted(
    monkeypatch: pytest.MonkeyPatch, status: int, answer: dict[str, Any], words: str
) -> None:
    async with opened(monkeypatch) as stage, scheduler_port(answer, status) as (url, _):
        stage.console.scheduler = SchedulerPort(url)
        browser = await signed_in(stage)
        page = await browser.post("/scheduler", fill(await browser.get("/scheduler"), action="replay", replay="5"))
        assert page.status == 502
        assert words in page.text


async def test_a_replay_without_an_address_or_an_answer_says_what_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        page = await browser.get("/scheduler")
        assert "--scheduler-url" in (await browser.post("/scheduler", fill(page, action="replay", replay="5"))).text
        stage.console.scheduler = SchedulerPort("http://127.0.0.1:1")
        assert "does not answer" in (await browser.post("/scheduler", fill(page, action="replay", replay="5"))).text
        for wrong in ("", "0", "501", "many", "0004999999", "\u0665", "5" * 5000):
            assert (await browser.post("/scheduler", fill(page, action="replay", replay=wrong))).status == 422


async def test_a_text_without_end_is_answered_with_a_page_of_its_own_size(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        csrf = (await browser.get("/scheduler")).field("csrf")
        text = "\n" * 80_000
        page = await browser.post("/scheduler", {"csrf": csrf, "action": "text", "text": text})
        assert "at most 49152 are edited here" in page.text
        assert "What differs is not shown" in page.text
        assert len(page.text) < 3 * len(text)


async def test_programs_read_and_write_the_configuration_as_json(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        browser = await signed_in(stage)
        config = json.loads((await browser.get("/api/config")).text)
        assert (config["config"], config["state"], config["mayWrite"]) == (TEXT, "running", True)
        csrf = (await browser.get("/scheduler")).field("csrf")
        text = build_text(plugins={"score": {"enabled": [{"name": "TopologyScore", "weight": 9}]}})
        fields = {"csrf": csrf, "config": text, "version": config["resourceVersion"]}
        wrong = await browser.post("/api/config", fields | {"config": text.replace("9", "-9")})
        assert wrong.status == 422
        assert json.loads(wrong.text)["problems"][0]["field"] == "p0-weight-TopologyScore"
        assert (await browser.post("/api/config", fields | {"version": "1"})).status == 409
        written = await browser.post("/api/config", fields)
        assert written.status == 200
        assert [version["by"] for version in json.loads(written.text)["versions"]] == [
            "unknown (not by the console)",
            "admin",
        ]
        assert api_of(stage).read_text() == text


async def test_programs_read_the_nodes_as_json(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened(monkeypatch) as stage:
        api_of(stage).put(NODES, node("edge-1", zone="hall-1", tier="edge"))
        browser = await signed_in(stage)
        answer = json.loads((await browser.get("/api/nodes")).text)
        (edge,) = answer["nodes"]
        assert (edge["name"], edge["zone"], edge["gracefulShutdown"]) == ("edge-1", "hall-1", False)
        assert edge["cpu"]["requestedMilli"] == 0


async def test_a_tunnel_that_cannot_be_opened_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    @asynccontextmanager
    async def fail() -> AsyncIterator[int]:
        raise NoTunnelError(f"no scheduler pod runs in namespace {HOSTILE}")
        yield 0

    async with opened(monkeypatch) as stage:
        stage.console.scheduler = SchedulerPort(tunnel=fail)
        browser = await signed_in(stage)
        page = await browser.post("/scheduler", fill(await browser.get("/scheduler"), action="replay", replay="5"))
        assert "There is no way to the scheduler: no scheduler pod runs" in page.text
        assert "<script>alert" not in page.text


async def test_each_replay_goes_through_a_tunnel_of_its_own_that_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []

    @asynccontextmanager
    async def tunnel() -> AsyncIterator[int]:
        events.append("open")
        yield 1
        events.append("never")

    async with opened(monkeypatch) as stage:
        stage.console.scheduler = SchedulerPort(tunnel=tunnel)
        browser = await signed_in(stage)
        page = await browser.post("/scheduler", fill(await browser.get("/scheduler"), action="replay", replay="5"))
        assert "The scheduler at https://127.0.0.1:1 does not answer" in page.text
        assert events == ["open"]
