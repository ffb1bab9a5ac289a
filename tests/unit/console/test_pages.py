"""Pages as users with different rights see them, and the proxies that sign them in."""

import asyncio
import re

import pytest
from tests.support.clients import until
from tests.unit.console.guarded_api import (
    ADMIN,
    APPS,
    CLAIMS,
    EVENTS,
    INSTANCES,
    NODES,
    PODS,
    POOLS,
    TELEMETRY,
    TENANT,
    Stage,
    staged,
)
from tests.unit.console.objects import app, device_claim, instance, node, pod, pool, telemetry

from robotapp_console.cluster import informer_sets
from robotapp_console.web import screens


def fill(stage: Stage) -> None:
    api = stage.api
    for namespace in ("team-a", "team-b"):
        body = api.put(APPS, app(f"teleop-{namespace}", namespace=namespace))
        uid = body["metadata"]["uid"]
        api.put(INSTANCES, instance(f"teleop-{namespace}", "amr-07", namespace=namespace, app_uid=uid))
    api.put(NODES, node("amr-07", robot="amr-07", zone="hall-1", tier="robot"))
    api.put(NODES, node("edge-1", zone="hall-1", tier="edge"))
    api.put(TELEMETRY, telemetry("amr-07", rtt={"edge-1": 2.0}, load={"cpuPercent": 12}))
    api.put(CLAIMS, device_claim("can-can0"))
    api.put(POOLS, pool(used="118/119"))
    api.put(PODS, pod("a", "amr-07"))


def find_refused(page: str) -> str:
    """Returns the kinds that a page says it does not show."""
    return " ".join(re.findall(r"Not shown: ([^<]*)", page))


async def test_who_may_read_everything_sees_the_fleet() -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        assert (await browser.sign_in(ADMIN)).headers["Location"] == "/"
        page = await browser.get("/")
        assert page.status == 200
        for text in (
            "amr-07",
            "hall-1",
            "teleop-team-a",
            "teleop-team-b",
            "2 ms",
            "1 held",
            "118 of 119",
            "admin",
            "<span>1 robot</span>",
        ):
            assert text in page.text
        assert "Not shown" not in page.text


async def test_a_tenant_sees_its_namespace_and_is_told_what_it_may_not_read() -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        await browser.sign_in(TENANT, home="team-a")
        page = await browser.get("/")
        assert "teleop-team-a" in page.text
        assert "teleop-team-b" not in page.text
        for kind in ("Nodes", "NodeTelemetries", "RobotClaims", "DomainPools"):
            assert kind in find_refused(page.text)
        assert "robotapp-cluster-viewer" in page.text
        assert "devices held (may not be read)" in page.text
        assert "RobotApps" not in find_refused(page.text)
        nodes = await browser.get("/nodes")
        assert "Nodes" in find_refused(nodes.text)
        assert "edge-1" not in nodes.text


async def test_without_a_namespace_a_tenant_learns_to_choose_one() -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        await browser.sign_in(TENANT)
        page = await browser.get("/")
        assert "RobotApps" in find_refused(page.text)
        assert "choose that namespace" in page.text
        chosen = await browser.get("/?namespace=team-a")
        assert "teleop-team-a" in chosen.text
        assert "RobotApps" not in find_refused(chosen.text)


async def test_one_kind_that_is_refused_greys_one_panel_only() -> None:
    async with staged() as stage:
        fill(stage)
        stage.api.forbidden = {"robotclaims"}
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        page = await browser.get("/")
        assert page.text.count("Not shown:") == 1
        assert "robotclaims" in page.text
        assert "2 ms" in page.text


async def test_a_namespace_narrows_what_is_shown_and_a_wrong_one_is_refused() -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        assert "teleop-team-b" not in (await browser.get("/?namespace=team-a")).text
        for wrong in ("Team", "a/b", "..", "a%2Fpods", "x" * 64):
            page = await browser.get(f"/?namespace={wrong}")
            assert page.status == 400
            assert "No namespace can have that name" in page.text


async def test_the_page_of_an_app_has_conditions_and_events_or_why_not() -> None:
    async with staged() as stage:
        fill(stage)
        uid = stage.api.store.select(APPS, "team-a")[0]["metadata"]["uid"]
        stage.api.put(
            EVENTS,
            {
                "metadata": {"name": "e", "namespace": "team-a"},
                "regarding": {"uid": uid},
                "reason": "Placed",
                "note": "2 of 2 on amr-07",
            },
        )
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        page = await browser.get("/apps/team-a/teleop-team-a")
        assert "<title>team-a/teleop-team-a · RobotApp</title>" in page.text
        assert "2 of 2 on amr-07" in page.text
        assert "kubectl robotapp explain teleop-team-a -n team-a" in page.text
        stage.api.forbidden = {"events"}
        stage.console.informers._sets.clear()
        assert "Not shown: events" in (await browser.get("/apps/team-a/teleop-team-a")).text


async def test_an_app_that_is_not_there_is_404_with_those_that_are() -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        page = await browser.get("/apps/team-a/gone")
        assert page.status == 404
        assert "/apps/team-a/teleop-team-a" in page.text
        assert (await browser.get("/apps/BAD/gone")).status == 400


async def test_an_empty_cluster_names_the_next_step() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        page = await browser.get("/")
        assert "kubectl label node NODE robotics.io/robot=NAME" in page.text
        assert "kubectl apply -f examples/minimal.yaml" in page.text
        assert "Nothing needs attention" in page.text


async def test_a_search_without_a_result_leads_back() -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        page = await browser.get("/?q=nobody")
        assert "No robot matches" in page.text
        assert 'value="nobody"' in page.text


@pytest.mark.parametrize("token", ["unknown-token", "", "with blank", "tökén"])
async def test_a_token_the_api_server_does_not_know_opens_nothing(token: str) -> None:
    async with staged() as stage:
        browser = stage.browser()
        page = await browser.sign_in(token)
        assert page.status in (401, 422)
        assert 'role="alert"' in page.text
        assert (await browser.get("/")).status == 303
        assert len(stage.console.informers) == 0


async def test_after_signing_in_the_page_that_was_asked_for_is_shown() -> None:
    async with staged() as stage:
        browser = stage.browser()
        asked = await browser.get("/nodes?q=amr")
        assert asked.headers["Location"] == "/login?next=%2Fnodes%3Fq%3Damr"
        assert (await browser.sign_in(ADMIN, to="/nodes?q=amr")).headers["Location"] == "/nodes?q=amr"
        assert (await stage.browser().sign_in(ADMIN, to="//evil.example")).headers["Location"] == "/"


async def test_a_token_that_has_expired_leads_to_the_login() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        assert (await browser.get("/")).status == 200
        del stage.api.tokens[ADMIN]
        informers = next(iter(stage.console.informers._sets.values()))
        stage.api.end_watches()
        await until(lambda: informers.signed_out, what="the watch is refused")
        page = await browser.get("/")
        assert (page.status, page.headers["Location"]) == (303, "/login")
        assert not any(name.startswith("__Host") for name in browser.cookies)


async def test_a_proxys_header_is_not_believed_unless_it_was_named() -> None:
    async with staged() as stage:
        assert (await stage.browser().get("/", **{"X-Forwarded-Access-Token": ADMIN})).status == 303
    async with staged(token_header="X-Forwarded-Access-Token") as stage:
        fill(stage)
        browser = stage.browser()
        page = await browser.get("/", **{"X-Forwarded-Access-Token": f"Bearer {ADMIN}"})
        assert page.status == 200
        assert "teleop-team-a" in page.text
        assert "Sign out" not in page.text
        wrong = await browser.get("/", **{"X-Forwarded-Access-Token": "wrong"})
        assert wrong.status == 401
        assert (await browser.get("/")).status == 303


async def test_a_cluster_without_robotapp_is_told_to_install_it() -> None:
    async with staged() as stage:
        stage.api.absent_groups = {"robotics.io"}
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        assert "install RobotApp" in (await browser.get("/")).text


@pytest.mark.parametrize(
    "query", ["q=%ff%fe", "zone=%ed%a0%80", "page=-1", "page=99999999999999999999", "sort=%00", "desc=x&q=%3Cscript%3E"]
)
async def test_any_address_shows_a_page(query: str) -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        for path in ("/", "/nodes"):
            page = await browser.get(f"{path}?{query}")
            assert page.status == 200
            assert "<script>" not in page.text
        assert (await browser.get(f"/apps/team-a/x?robot={query[-5:]}")).status == 404


async def test_what_an_address_asks_for_in_vain_is_named() -> None:
    async with staged() as stage:
        fill(stage)
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        for path, text in (
            ("/?zone=hall-9", "<option selected>hall-9</option>"),
            ("/nodes?tier=moon", "<option selected>moon</option>"),
            ("/nodes?near=hall-1&far=hall-9", "No node is in zone hall-9."),
        ):
            assert text in (await browser.get(path)).text
        page = await browser.get("/fleet")
        assert (page.status, "The console has no page /fleet." in page.text) == (404, True)


async def test_raw_bytes_in_an_address_do_no_harm() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        port = int(stage.base.rpartition(":")[2])
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(
            b"GET /?q=\xff\xfe\xed HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept: text/html\r\nConnection: close\r\nCookie: "
            + browser.cookie_header.encode()
            + b"\r\n\r\n"
        )
        answer = await reader.read()
        writer.close()
        assert answer.split()[1] in (b"200", b"400")


async def test_too_many_users_at_once_are_told_to_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    async with staged() as stage:
        first, second = stage.browser(), stage.browser()
        await first.sign_in(ADMIN)
        monkeypatch.setattr(informer_sets, "MOST_SETS", 1)
        page = await second.sign_in(TENANT)
        assert page.status == 503
        assert "Try again in a minute" in page.text
        assert (await first.get("/")).status == 200


async def test_a_bug_shows_nothing_of_itself(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    def fail(_snapshot: object) -> None:
        raise ZeroDivisionError("inner detail")

    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        monkeypatch.setattr(screens, "build_fleet", fail)
        page = await browser.get("/")
        assert page.status == 500
        assert "inner detail" not in page.text
        assert "inner detail" in caplog.text
        assert page.headers["Content-Security-Policy"]
