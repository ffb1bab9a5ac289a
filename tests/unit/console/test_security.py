"""What must hold for every request: sessions, Host, Origin, CSRF tokens, headers, limits, and where tokens never stand."""

import asyncio
import logging
from dataclasses import replace
from urllib.parse import urlsplit

import pytest
from tests.unit.console.guarded_api import ADMIN, NODES, TENANT, staged
from tests.unit.console.objects import node

from robotapp_console.cluster import informer_sets
from robotapp_console.web import guard
from robotapp_console.web.security import clean_next
from robotapp_console.web.server import LIMITS
from robotapp_console.web.sessions import LONGEST_S, Seal, hash_token

PATHS = (
    "/",
    "/nodes",
    "/apps/default/teleop",
    "/stream",
    "/nodes/stream",
    "/apps/default/teleop/stream",
    "/no-such-page",
    "/open",
)


@pytest.mark.parametrize("path", PATHS)
async def test_without_a_session_pages_lead_to_the_login_and_programs_get_401(path: str) -> None:
    async with staged() as stage:
        browser = stage.browser()
        page = await browser.get(path)
        assert page.status == (404 if path == "/open" else 303)
        if page.status == 303:
            assert page.headers["Location"].startswith("/login")
            assert (await browser.get(path, Accept="*/*")).status == 401
            assert (await browser.get(path, **{"HX-Request": "true"})).status == 401
            assert (await browser.post(path, {})).status == 403
        assert not stage.api.requests


@pytest.mark.parametrize("path", PATHS[:-1])
async def test_the_local_console_answers_401_without_its_session(path: str) -> None:
    async with staged(local=True) as stage:
        assert (await stage.browser().get(path)).status == 401


async def test_a_link_from_another_site_is_opened_by_a_second_request_of_our_own() -> None:
    async with staged() as stage:
        browser = stage.browser()
        headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
        page = await browser.get('/nodes?q="><script>', **headers)
        assert page.status == 401
        assert 'http-equiv="refresh" content="0; url=/nodes?q=' in page.text
        assert "<script>" not in page.text
        await browser.sign_in(ADMIN)
        assert (await browser.get("/nodes", **headers)).status == 200


async def test_login_static_files_and_health_need_no_session() -> None:
    async with staged() as stage:
        browser = stage.browser()
        assert (await browser.get("/healthz")).text == "ok\n"
        assert (await browser.get("/login")).status == 200
        style = await browser.get("/static/console.css")
        assert style.status == 200
        assert "max-age" in style.headers["Cache-Control"]
        assert (await browser.get("/static/../main.py")).status in (303, 404)
        assert (await browser.get("/static/%2e%2e/main.py")).status in (303, 404)


async def test_every_answer_has_the_security_headers_and_no_page_is_cached() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        for path in ("/", "/login", "/nodes", "/apps/default/none", "/no-such-page", "/?namespace=NO"):
            page = await browser.get(path)
            policy = page.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy
            assert "unsafe" not in policy
            assert "frame-ancestors 'none'" in policy
            assert page.headers["X-Content-Type-Options"] == "nosniff"
            assert page.headers["Referrer-Policy"] == "same-origin"
            assert page.headers["Cache-Control"] == "no-store"
            assert "aiohttp" not in page.headers["Server"]


async def test_no_page_has_a_script_style_or_handler_of_its_own() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        for path in ("/", "/nodes", "/login"):
            text = (await browser.get(path)).text
            assert "<style" not in text
            assert " style=" not in text
            assert " onclick" not in text
            assert text.count("<script") == text.count("<script src=")


async def test_the_token_is_in_no_page_no_address_and_no_log(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    async with staged() as stage:
        browser = stage.browser()
        texts = [await browser.sign_in(ADMIN), await stage.browser().sign_in("wrong-" + TENANT)]
        texts += [await browser.get(path) for path in ("/", "/nodes", "/apps/default/none", "/login")]
        for page in texts:
            assert ADMIN not in page.text
            assert TENANT not in page.text
            assert ADMIN not in page.headers.get("Location", "")
        assert all(ADMIN not in value for value in browser.cookies.values())
        assert all(ADMIN not in path for _, path in stage.api.requests)
    assert ADMIN not in caplog.text
    assert TENANT not in caplog.text


async def test_the_session_cookie_is_out_of_reach_for_scripts_and_other_sites() -> None:
    async with staged() as stage:
        answer = await stage.browser().sign_in(ADMIN)
        cookie = next(line for line in answer.headers.getall("Set-Cookie") if line.startswith("__Host-"))
        for attribute in ("HttpOnly", "Secure", "SameSite=Strict", "Path=/"):
            assert attribute in cookie
        assert "Domain" not in cookie
        age = int(cookie.split("Max-Age=")[1].split(";")[0])
        assert LONGEST_S - 5 <= age <= LONGEST_S


@pytest.mark.parametrize(
    ("headers", "csrf"),
    [
        ({"Origin": ""}, True),
        ({"Origin": "null"}, True),
        ({"Origin": "https://evil.example"}, True),
        ({"Origin": "http://127.0.0.1:1"}, True),
        ({}, False),
    ],
)
async def test_a_write_from_elsewhere_or_without_its_csrf_token_is_refused(headers: dict[str, str], csrf: bool) -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        right = (await browser.get("/")).field("csrf")
        refused = await browser.post("/logout", {"csrf": right if csrf else "0" * 64}, **headers)
        assert refused.status == 403
        assert (await browser.get("/")).status == 200, "the session goes on"
        assert (await browser.post("/logout", {"csrf": right})).status == 303


async def test_the_login_form_needs_its_token_as_well() -> None:
    async with staged() as stage:
        browser, stranger = stage.browser(), stage.browser()
        stolen = (await stranger.get("/login")).field("csrf")
        await browser.get("/login")
        assert (await browser.post("/login", {"token": ADMIN, "csrf": stolen})).status == 403


@pytest.mark.parametrize("nonce", ["ANYTHING-I-LIKE", "n" * 24, "n" * 25, "\udcff" * 24])
async def test_the_login_form_signs_no_session_that_a_browser_makes_up(nonce: str) -> None:
    async with staged() as stage:
        browser = stage.browser()
        browser.cookies["robotapp-console-login"] = nonce
        form = await browser.get("/login")
        assert form.status == 200
        assert not stage.console.seal.is_signed(nonce.encode("utf-8", "replace").decode(), form.field("csrf"))
        assert (await browser.post("/login", {"token": ADMIN, "csrf": form.field("csrf")})).status == 303


async def test_one_session_cannot_use_the_csrf_token_of_another() -> None:
    async with staged() as stage:
        one, other = stage.browser(), stage.browser()
        await one.sign_in(ADMIN)
        await other.sign_in(ADMIN)
        assert (await one.post("/logout", {"csrf": (await other.get("/")).field("csrf")})).status == 403


async def test_after_signing_out_a_copy_of_the_cookie_is_worthless() -> None:
    async with staged() as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        copied = dict(browser.cookies)
        await browser.post("/logout", {"csrf": (await browser.get("/")).field("csrf")})
        browser.cookies = copied
        assert (await browser.get("/")).status == 303


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1.evil.example:80", "evil.example:80"])
async def test_a_rebound_name_does_not_reach_the_local_console(host: str) -> None:
    async with staged(local=True) as stage:
        browser = stage.browser()
        door = stage.console.door
        assert door is not None
        assert (await browser.get(door.path, Host=host)).status == 403
        assert (await browser.get(door.path)).status == 303
        assert (await browser.get("/", Host=host)).status == 403
        assert (await browser.get("/static/console.css", Host=host)).status == 403
        assert (await browser.get("/")).status == 200


async def test_the_one_time_address_works_once_and_another_takes_its_place() -> None:
    async with staged(local=True) as stage:
        opened: list[str] = []
        door = stage.console.door
        assert door is not None
        stage.console.on_opened = lambda: opened.append(door.path)
        path = door.path
        first, second = stage.browser(), stage.browser()
        assert (await first.get(path)).status == 303
        assert (await second.get(path)).status == 401
        assert (await second.get("/")).status == 401
        assert opened != [path]
        assert (await second.get(opened[0])).status == 303
        assert (await second.get("/")).status == 200
        assert (await first.get("/login")).status == 404


async def test_hosts_can_be_named_for_the_cluster_too() -> None:
    async with staged(hosts=frozenset({"console.example.org"})) as stage:
        assert (await stage.browser().get("/login")).status == 403
        assert (await stage.browser().get("/login", Host="console.example.org")).status == 200


async def test_who_asks_too_often_is_told_to_wait_and_others_are_not() -> None:
    async with staged() as stage:
        busy, calm = stage.browser(), stage.browser()
        await busy.sign_in(ADMIN)
        await calm.sign_in(TENANT)
        pages = [await busy.get("/no-such-page") for _ in range(200)]
        assert {page.status for page in pages} == {404, 429}
        assert all(page.headers["Retry-After"] for page in pages if page.status == 429)
        assert (await calm.get("/")).status == 200


async def test_guessing_tokens_is_slow() -> None:
    async with staged() as stage:
        browser = stage.browser()
        csrf = (await browser.get("/login")).field("csrf")
        statuses = [(await browser.post("/login", {"token": f"guess-{i}", "csrf": csrf})).status for i in range(60)]
        assert statuses.count(401) < 40
        assert set(statuses) == {401, 429}


async def test_behind_an_ingress_one_stranger_keeps_nobody_else_from_signing_in() -> None:
    async with staged(behind_proxy=True) as stage:
        stranger, other = stage.browser(), stage.browser()
        forged = [f"203.0.113.{number}, 198.51.100.7" for number in range(60)]
        statuses = [(await stranger.get("/login", **{"X-Forwarded-For": hops})).status for hops in forged]
        assert set(statuses) == {200, 429}
        assert (await other.get("/login", **{"X-Forwarded-For": "198.51.100.7, 203.0.113.1"})).status == 200
        assert (await other.get("/login", **{"X-Forwarded-For": "nonsense"})).status == 200


async def test_who_reaches_the_console_itself_has_the_address_of_his_connection() -> None:
    async with staged() as stage:
        browser = stage.browser()
        forged = [f"203.0.113.{number}" for number in range(60)]
        statuses = [(await browser.get("/login", **{"X-Forwarded-For": hop})).status for hop in forged]
        assert set(statuses) == {200, 429}


async def test_tokens_that_a_stranger_makes_up_take_no_place_of_a_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(informer_sets, "MOST_SETS", 2)
    async with staged(token_header="X-Token") as stage:
        for number in range(5):
            for path in ("/", "/scheduler", "/login"):
                refused = await stage.browser().get(path, **{"X-Token": f"made-up-{number}"})
                assert refused.status == 401
                assert "does not accept the credentials" in refused.text
        assert len(stage.console.informers) == 0
        assert (await stage.browser().get("/", **{"X-Token": ADMIN})).status == 200


async def test_half_a_request_of_a_stranger_ends_and_an_open_page_goes_on() -> None:
    async with staged(limits=replace(LIMITS, head_s=0.2, idle_s=0.2)) as stage:
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        address = urlsplit(stage.base)
        async with stage.http.get(f"{stage.base}/stream", headers={"Cookie": browser.cookie_header}) as stream:
            await stream.content.readline()
            reader, writer = await asyncio.open_connection(address.hostname, address.port)
            writer.write(b"GET / HTTP/1.1\r\nHost: x\r\nX:")
            async with asyncio.timeout(20):
                assert await reader.read() == b""
            writer.close()
            stage.api.put(NODES, node("amr-07", robot="amr-07"))
            async with asyncio.timeout(20):
                while b"amr-07" not in (line := await stream.content.readline()):
                    assert line, "the open page was ended"


async def test_more_connections_than_the_console_takes_end_the_one_that_waits_longest() -> None:
    async with staged(limits=replace(LIMITS, connections=3)) as stage:
        address = urlsplit(stage.base)
        peers = [await asyncio.open_connection(address.hostname, address.port) for _ in range(4)]
        async with asyncio.timeout(20):
            assert await peers[0][0].read() == b""
        assert (await stage.browser().get("/healthz")).status == 200
        for _, writer in peers:
            writer.close()


async def test_a_form_that_does_not_arrive_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "_BODY_S", 0.1)
    async with staged() as stage:
        address = urlsplit(stage.base)
        reader, writer = await asyncio.open_connection(address.hostname, address.port)
        head = f"POST /login HTTP/1.1\r\nHost: {address.netloc}\r\nOrigin: {stage.base}\r\nContent-Length: 2000\r\n"
        writer.write(f"{head}Content-Type: application/x-www-form-urlencoded\r\n\r\na=".encode())
        async with asyncio.timeout(20):
            assert b" 408 " in await reader.readline()
            await reader.read()
        writer.close()


def test_a_cookie_that_was_changed_or_made_elsewhere_is_no_session() -> None:
    seal, other = Seal(b"a" * 32), Seal(b"b" * 32)
    session, cookie = seal.open_session(ADMIN, user="admin", home="")
    read = seal.read_session(cookie)
    assert read is not None
    assert (read.token, read.user) == (ADMIN, "admin")
    assert other.read_session(cookie) is None
    assert seal.read_session(cookie[:-4] + "AAA=") is None
    assert seal.read_session("") is None
    assert seal.read_session("ü") is None
    assert not other.is_signed(session.id, seal.sign(session.id))
    assert ADMIN not in repr(session)
    assert ADMIN not in hash_token(ADMIN)


def test_a_token_that_no_cookie_can_hold_is_refused() -> None:
    with pytest.raises(ValueError, match="too long"):
        Seal(b"a" * 32).open_session("t" * 4000, user="", home="")


@pytest.mark.parametrize(
    ("path", "result"),
    [
        ("/nodes?q=1", "/nodes?q=1"),
        ("//evil.example", "/"),
        ("/\\evil.example", "/"),
        ("https://evil.example", "/"),
        ("", "/"),
        ("/a\nLocation: x", "/"),
        ("/a\\b", "/"),
    ],
)
def test_after_signing_in_nobody_is_sent_to_another_site(path: str, result: str) -> None:
    assert clean_next(path) == result
