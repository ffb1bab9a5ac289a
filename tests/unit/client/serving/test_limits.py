"""How much a caller may request: strangers cannot take anything from callers the API server has confirmed."""

import contextlib

import pytest
from tests.support.scripted import ScriptedClient

from robotapp_client.serving.access import (
    ADDRESS_AT_ONCE,
    CACHE_LIMIT,
    CALLER_AT_ONCE,
    REMEMBER_S,
    STRANGERS_AT_ONCE,
    Access,
    Caller,
    Gatekeeper,
    TooManyError,
)

UNKNOWN = {"status": {"authenticated": False}}
AMY = {"status": {"authenticated": True, "user": {"username": "amy"}}}
YES = {"status": {"allowed": True}}


def keeper(*answers: object) -> tuple[Gatekeeper, ScriptedClient]:
    client = ScriptedClient().script("create", *answers)
    return Gatekeeper(client, clock=client.clock), client


async def test_500_bad_tokens_of_one_address_are_few_reviews() -> None:
    gate, client = keeper(*[UNKNOWN] * 500)
    refused = 0
    for number in range(500):
        try:
            assert await gate.path(Caller(f"bad-{number}", address="a"), "get", "/metrics") is Access.UNKNOWN_CALLER
        except TooManyError:
            refused += 1
    assert (len(client.calls), refused) == (ADDRESS_AT_ONCE, 500 - ADDRESS_AT_ONCE)


async def test_the_same_bad_token_is_reviewed_once() -> None:
    gate, client = keeper(UNKNOWN, UNKNOWN)
    for _ in range(500):
        assert await gate.path(Caller("bad", address="a"), "get", "/metrics") is Access.UNKNOWN_CALLER
    assert len(client.calls) == 1
    client.now_s += REMEMBER_S
    await gate.path(Caller("bad", address="a"), "get", "/metrics")
    assert len(client.calls) == 2


async def test_a_confirmed_caller_is_served_whatever_strangers_do() -> None:
    """A thousand bad tokens used to empty the cache: everybody was reviewed anew with each request."""
    gate, client = keeper(AMY, YES, *[UNKNOWN] * 2000)
    amy = Caller("amy's", address="a")
    await gate.path(amy, "get", "/metrics")
    for number in range(2 * CACHE_LIMIT):
        client.now_s += 0.001
        with contextlib.suppress(TooManyError):
            await gate.path(Caller(f"bad-{number}", address=f"address-{number}"), "get", "/metrics")
    before = len(client.calls)
    assert STRANGERS_AT_ONCE < before < STRANGERS_AT_ONCE + 60
    assert await gate.path(amy, "get", "/metrics") is Access.ALL
    assert len(client.calls) == before
    client.now_s += REMEMBER_S
    while gate._all.wait_s("") == 0:  # strangers take all there is
        pass
    gate._client = ScriptedClient().script("create", AMY, YES)
    assert await gate.path(amy, "get", "/metrics") is Access.ALL
    assert gate.user_of(amy) == "amy"


async def test_a_confirmed_caller_too_asks_only_so_much() -> None:
    gate, _ = keeper(*[AMY, YES, YES] * 200)
    amy = Caller("amy's", address="a")
    for number in range(CALLER_AT_ONCE + 1):  # the first as a stranger
        await gate.access(amy, f"ns-{number}")
    with pytest.raises(TooManyError):
        await gate.access(amy, "one-more")
