"""Streams: what changes reaches open pages, one informer set serves all pages of a user, broken watches resume."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from aiohttp import ClientResponse
from tests.support.clients import until
from tests.unit.console.guarded_api import ADMIN, APPS, NODES, TENANT, Browser, Stage, staged
from tests.unit.console.objects import app, node

from robotapp_console.cluster import feed, informer_set, rights


class Stream:
    """The messages of one open page."""

    def __init__(self, answer: ClientResponse) -> None:
        self.answer = answer

    async def next_message(self, timeout_s: float = 5.0) -> str:
        lines: list[str] = []
        async with asyncio.timeout(timeout_s):
            while True:
                line = (await self.answer.content.readline()).decode()
                if not line:
                    raise EOFError
                if line.startswith("data:"):
                    lines.append(line[6:])
                elif lines and line == "\n":
                    return "".join(lines)

    async def find(self, text: str, timeout_s: float = 5.0) -> str:
        async with asyncio.timeout(timeout_s):
            while text not in (message := await self.next_message(timeout_s)):
                pass
        return message


@asynccontextmanager
async def opened(stage: Stage, browser: Browser, path: str = "/stream") -> AsyncIterator[Stream]:
    headers = {"HX-Request": "true", "Cookie": browser.cookie_header}
    async with stage.http.get(stage.base + path, headers=headers) as answer:
        assert answer.status == 200
        assert answer.headers["Content-Type"] == "text/event-stream"
        yield Stream(answer)


async def test_a_change_between_the_page_and_its_stream_is_not_lost() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        await browser.get("/")
        stage.api.put(NODES, node("amr-07", robot="amr-07"))
        (informers,) = stage.console.informers._sets.values()
        await until(lambda: informers.is_behind(("fleet",), namespace="", home=""), what="change")
        async with opened(stage, browser) as stream:
            await stream.find("amr-07")


async def test_a_change_reaches_an_open_page_within_the_blink_of_an_eye() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        async with opened(stage, browser) as stream:
            assert "amr-07" not in await stream.next_message()
            await asyncio.sleep(0.5)
            changed_s = time.monotonic()
            stage.api.put(NODES, node("amr-07", robot="amr-07"))
            await stream.find("amr-07")
            assert time.monotonic() - changed_s < 2.0


async def test_a_message_is_the_part_of_the_page_that_changes_and_nothing_else() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        stage.api.put(APPS, app("teleop"))
        for path in ("/stream", "/nodes/stream", "/apps/default/teleop/stream"):
            async with opened(stage, browser, path) as stream:
                message = await stream.next_message()
                assert "<html" not in message
                assert "csrf" not in message


async def test_a_change_that_does_not_show_sends_nothing() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        stage.api.put(NODES, node("amr-07", robot="amr-07"))
        async with opened(stage, browser) as stream:
            await stream.find("amr-07")
            stage.api.put(NODES, node("amr-07", robot="amr-07", labels={"no": "matter"}))
            with pytest.raises(TimeoutError):
                await stream.next_message(1.5)


async def test_all_pages_of_a_user_share_one_set_of_watches_and_users_do_not() -> None:
    async with staged() as stage:
        one, other, tenant = stage.browser(), stage.browser(), stage.browser()
        await one.sign_in(ADMIN)
        await other.sign_in(ADMIN)
        await tenant.sign_in(TENANT, home="team-a")
        async with opened(stage, one) as first, opened(stage, other) as second, opened(stage, one) as third:
            for stream in (first, second, third):
                await stream.next_message()
            await until(lambda: len(stage.api.watches) == 8, what="eight watches")
            assert len(set(stage.api.watches)) == 8
            await tenant.get("/")
            await until(lambda: ("tenant", "robotapps") in stage.api.watches, what="the tenant's own watch")
        assert len(stage.console.informers) == 2


async def test_a_set_that_no_page_uses_ends_and_with_it_its_watches() -> None:
    async with staged(idle_s=0.2) as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        async with opened(stage, browser) as stream:
            await stream.next_message()
            await asyncio.sleep(0.6)
            assert len(stage.console.informers) == 1, "an open page uses it"
        await until(lambda: len(stage.console.informers) == 0, what="the set has ended", timeout_s=30)
        await until(lambda: stage.api.watching == 0, what="the watches have ended")
        assert (await browser.get("/")).status == 200, "the next page makes a new one"


async def test_a_broken_watch_is_told_and_resumes_by_itself() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        async with opened(stage, browser) as stream:
            await stream.next_message()
            await until(lambda: stage.api.watching == 8, what="eight watches")
            stage.api.failing = [500] * 40
            stage.api.break_watches()
            message = await stream.find("stale since")
            assert "Nodes: stale since" in message
            stage.api.failing.clear()
            while "stale since" in await stream.next_message(15.0):
                pass
            stage.api.put(NODES, node("amr-07", robot="amr-07"))
            await stream.find("amr-07")


async def test_a_right_that_is_taken_greys_the_panel_of_an_open_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed, "REFUSED_RETRY_S", 0.2)
    monkeypatch.setattr(feed, "CONFIRM_S", 0.2)
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        stage.api.put(NODES, node("amr-07", robot="amr-07"))
        async with opened(stage, browser) as stream:
            await stream.find("amr-07")
            stage.api.forbidden = {"nodes"}
            stage.api.end_watches()
            message = await stream.find("Not shown: Nodes")
            assert "amr-07" not in message
            stage.api.forbidden = set()
            await stream.find("amr-07")


async def test_a_right_that_is_taken_shows_although_the_watch_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(informer_set, "REVIEW_S", 0.1)
    monkeypatch.setattr(rights, "KEPT_S", 0.1)
    monkeypatch.setattr(feed, "REFUSED_RETRY_S", 0.2)
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        stage.api.put(NODES, node("amr-07", robot="amr-07"))
        async with opened(stage, browser) as stream:
            await stream.find("amr-07")
            await until(lambda: stage.api.watching == 8, what="eight watches")
            stage.api.forbidden = {"nodes"}
            message = await stream.find("Not shown: Nodes")
            assert "amr-07" not in message
            stage.api.forbidden = set()
            await stream.find("amr-07")


async def test_a_review_that_refuses_once_takes_nothing() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        await browser.get("/")
        (informers,) = stage.console.informers._sets.values()
        stage.api.forbidden = {"nodes"}
        doubted = await informers._review_rights(frozenset())
        assert [one.kind.plural for one in doubted] == ["nodes"]
        stage.api.forbidden = set()
        assert await informers._review_rights(doubted) == frozenset()
        assert "Not shown" not in (await browser.get("/")).text


async def test_a_token_that_is_no_longer_valid_ends_the_open_pages_although_their_watches_go_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(informer_set, "REVIEW_S", 0.1)
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        async with opened(stage, browser) as stream:
            await until(lambda: stage.api.watching == 8, what="eight watches")
            await stream.next_message()
            del stage.api.tokens[ADMIN]
            with pytest.raises(EOFError):
                await stream.next_message()
        assert (await browser.get("/")).headers["Location"] == "/login"


async def test_the_page_of_an_app_shows_nothing_when_its_events_tell_that_the_token_is_not_valid() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        await browser.get("/")
        stage.api.put(APPS, app("teleop"))
        (informers,) = stage.console.informers._sets.values()
        await until(lambda: "default/teleop" in informers.take_snapshot("", "").apps, what="the app")
        del stage.api.tokens[ADMIN]
        page = await browser.get("/apps/default/teleop")
        assert "does not accept your credentials" in page.text
        assert "Conditions" not in page.text
        assert (await browser.get("/apps/default/teleop")).headers["Location"] == "/login"


async def test_a_refusal_that_passes_greys_nothing() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        stage.api.put(NODES, node("amr-07", robot="amr-07"))
        async with opened(stage, browser) as stream:
            await stream.find("amr-07")
            stage.api.forbidden = {"nodes"}
            stage.api.end_watches()
            message = await stream.find("stale since")
            assert "Not shown" not in message
            assert "amr-07" in message
            stage.api.forbidden = set()
            while "stale since" in await stream.next_message(15.0):
                pass


async def test_an_app_that_is_deleted_is_told_on_its_open_page() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        stage.api.put(APPS, app("teleop"))
        async with opened(stage, browser, "/apps/default/teleop/stream") as stream:
            await stream.find("Conditions")
            stage.api.remove(APPS, "teleop", "default")
            await stream.find("There is no RobotApp default/teleop")


async def test_signing_out_ends_the_open_pages() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        async with opened(stage, browser) as stream:
            await stream.next_message()
            await browser.post("/logout", {"csrf": (await browser.get("/")).field("csrf")})
            with pytest.raises(EOFError):
                await stream.next_message()


async def test_stopping_the_console_ends_the_open_pages_at_once() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        async with opened(stage, browser) as stream:
            await stream.next_message()
            stage.console.ending.set()
            with pytest.raises(EOFError):
                await stream.next_message()
