"""Tokens, connections and time-outs on the wire."""

import asyncio
import dataclasses
from typing import Any

import pytest
from tests.support.clients import client_for, posted_soon
from tests.support.scripted import ScriptedServer, hang_up, item, refusal, reply, silence, watch

from robotapp_client import Endpoint, Unauthorized, Unreachable
from robotapp_client.api.resources import NODES
from robotapp_client.transport.credentials import Credentials, Token
from robotapp_client.transport.errors import LoginError
from robotapp_client.transport.http_transport import HttpTransport


def numbered_tokens() -> Credentials:
    issued: list[int] = []

    async def source() -> Token:
        issued.append(1)
        return Token(f"t{len(issued)}")

    return Credentials(source)


def with_credentials(endpoint: Endpoint, credentials: Credentials) -> Endpoint:
    return dataclasses.replace(endpoint, credentials=credentials)


async def test_every_request_carries_the_token() -> None:
    async with ScriptedServer(reply(item("a", 1)), watch()) as server:
        endpoint = with_credentials(server.endpoint, Credentials.fixed("secret"))
        async with client_for(endpoint) as client:
            await client.get(NODES, "a")
            async with client.stream("/x", silence_s=5) as stream:
                assert await stream.read() == b""
    assert [seen.headers["Authorization"] for seen in server.seen] == ["Bearer secret"] * 2


WRITES = pytest.mark.parametrize(
    "write",
    [lambda client: client.post_raw("/x", b"{}"), lambda client: posted_soon(client, "/x", b"{}")],
    ids=["post_raw", "post_soon"],
)


@WRITES
async def test_after_a_401_a_fresh_token_is_tried_once_for_writes_too(write: Any) -> None:
    # A 401 means: not executed. It is the one answer after which even a write may be sent again.
    async with (
        ScriptedServer(refusal(401), reply({})) as server,
        client_for(with_credentials(server.endpoint, numbered_tokens())) as client,
    ):
        await write(client)
    assert [seen.headers["Authorization"] for seen in server.seen] == ["Bearer t1", "Bearer t2"]


@WRITES
async def test_a_token_that_cannot_be_had_is_an_error_of_the_request(write: Any) -> None:
    async def source() -> Token:
        raise LoginError("no token today")

    async with (
        ScriptedServer() as server,
        client_for(with_credentials(server.endpoint, Credentials(source))) as client,
    ):
        with pytest.raises(LoginError, match="no token today"):
            await write(client)
    assert server.seen == []


@WRITES
async def test_a_second_401_is_an_error(write: Any) -> None:
    async with (
        ScriptedServer(refusal(401), refusal(401), reply({})) as server,
        client_for(with_credentials(server.endpoint, numbered_tokens())) as client,
    ):
        with pytest.raises(Unauthorized):
            await write(client)
    assert len(server.seen) == 2


async def test_a_fixed_token_is_not_tried_twice() -> None:
    async with (
        ScriptedServer(refusal(401)) as server,
        client_for(with_credentials(server.endpoint, Credentials.fixed("x"))) as client,
    ):
        with pytest.raises(Unauthorized):
            await client.post_raw("/x", b"{}")
    assert len(server.seen) == 1


async def test_a_watch_with_an_expired_token_gets_a_fresh_one_next_time() -> None:
    async with (
        ScriptedServer(refusal(401), watch()) as server,
        client_for(with_credentials(server.endpoint, numbered_tokens())) as client,
    ):
        for expected in (401, 200):
            async with client.stream("/x", silence_s=5) as stream:
                assert stream.status == expected
                await stream.read()
    assert [seen.headers["Authorization"] for seen in server.seen] == ["Bearer t1", "Bearer t2"]


async def test_old_tokens_do_not_pile_up() -> None:
    credentials = Credentials.fixed("0")
    async with (
        ScriptedServer(*[reply({})] * 40) as server,
        HttpTransport(with_credentials(server.endpoint, credentials), user_agent="x") as transport,
    ):
        for number in range(40):
            credentials.authorization = f"Bearer {number}"
            await transport.request("GET", "/x", timeout_s=5)
        assert len(transport._headers) <= 17
    assert server.seen[-1].headers["Authorization"] == "Bearer 39"


async def test_connections_are_kept_alive() -> None:
    async with ScriptedServer(*[reply({})] * 5) as server, client_for(server.endpoint) as client:
        for _ in range(5):
            await client.post_raw("/x", b"{}")
    assert server.connections == 1


async def test_no_more_connections_than_allowed_and_watches_do_not_count() -> None:
    async with (
        ScriptedServer(watch(then="hang"), *[reply({})] * 20) as server,
        client_for(server.endpoint, max_connections=2) as client,
        client.stream("/w", silence_s=5),
    ):
        await asyncio.gather(*(client.post_raw("/x", b"{}") for _ in range(20)))
    assert server.connections == 3


async def test_a_stream_breaks_off_after_its_silence() -> None:
    async with (
        ScriptedServer(watch(b"hello\n", then="hang")) as server,
        client_for(server.endpoint) as client,
        client.stream("/x", silence_s=0.05) as stream,
    ):
        taken: list[bytes] = []
        with pytest.raises(Unreachable, match="GET /x"):
            await stream.deliver(taken.extend)
        assert taken == [b"hello\n"]


@pytest.mark.parametrize("failure", [hang_up(), silence()], ids=["closed", "silent"])
async def test_a_stream_that_does_not_begin_is_unreachable(failure: object) -> None:
    async with ScriptedServer(failure) as server, client_for(server.endpoint) as client:  # type: ignore[arg-type]
        with pytest.raises(Unreachable):
            async with client.stream("/x", silence_s=0.05):
                pass


async def test_the_query_is_no_part_of_error_messages() -> None:
    async with ScriptedServer(hang_up()) as server, client_for(server.endpoint) as client:
        with pytest.raises(Unreachable, match=r"^POST /x: "):
            await client.post_raw("/x?token=secret", b"{}")
        assert "connections" in repr(client._transport)


async def test_a_client_that_is_not_open_says_so_and_sends_nothing() -> None:
    async with ScriptedServer() as server:
        client = client_for(server.endpoint)
        with pytest.raises(Unreachable, match="never entered") as caught:
            await client.post_raw("/x", b"{}")
        async with client:
            pass
        with pytest.raises(Unreachable, match="closed"):
            async with client.stream("/x", silence_s=1):
                pass
    assert not caught.value.maybe_applied
