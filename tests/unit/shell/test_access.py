from typing import Any

import pytest
from tests.support.scripted_client import ScriptedClient

from robotapp_api.client.errors import Unreachable
from robotapp_scheduler.shell.access import REMEMBER_S, Access, Gatekeeper

USER = {"username": "eve", "uid": "1", "groups": ["devs"], "extra": {"k": ["v"]}}
KNOWN = {"status": {"authenticated": True, "user": USER}}


def allowed(answer: bool) -> dict[str, Any]:
    return {"status": {"allowed": answer}}


def gatekeeper(*answers: Any) -> tuple[Gatekeeper, ScriptedClient]:
    client = ScriptedClient().script("create", *answers)
    return Gatekeeper(client, clock=client.clock), client  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("answers", "access"),
    [
        ([{"status": {"authenticated": False}}], Access.UNKNOWN_CALLER),
        ([{}], Access.UNKNOWN_CALLER),
        ([KNOWN, allowed(False)], Access.FORBIDDEN),
        ([KNOWN, allowed(True), allowed(False)], Access.WITHOUT_NODES),
        ([KNOWN, allowed(True), allowed(True)], Access.ALL),
    ],
)
async def test_the_api_server_decides(answers: list[Any], access: Access) -> None:
    keeper, _ = gatekeeper(*answers)
    assert await keeper.access("t", "team-a") is access


async def test_the_review_asks_for_this_user_this_namespace_and_nothing_more() -> None:
    keeper, client = gatekeeper(KNOWN, allowed(True), allowed(True))
    await keeper.access("t", "team-a")
    assert client.calls[0][2] == {"spec": {"token": "t"}}
    pods = client.calls[1][2]["spec"]
    assert (pods["user"], pods["groups"], pods["extra"]) == ("eve", ["devs"], {"k": ["v"]})
    assert pods["resourceAttributes"] == {"verb": "get", "resource": "pods", "namespace": "team-a"}
    assert client.calls[2][2]["spec"]["resourceAttributes"] == {"verb": "get", "resource": "nodes"}


async def test_no_token_asks_nobody() -> None:
    keeper, client = gatekeeper()
    assert await keeper.access("", "team-a") is Access.UNKNOWN_CALLER
    assert client.calls == []


async def test_an_answer_is_remembered_for_some_seconds_per_namespace() -> None:
    keeper, client = gatekeeper(*[KNOWN, allowed(False)] * 3)
    for _ in range(3):
        await keeper.access("t", "team-a")
    assert len(client.calls) == 2
    await keeper.access("t", "team-b")
    assert len(client.calls) == 4
    client.now_s += REMEMBER_S
    await keeper.access("t", "team-a")
    assert len(client.calls) == 6


async def test_without_an_api_server_nobody_is_let_in() -> None:
    keeper, _ = gatekeeper(Unreachable("down", maybe_applied=False))
    with pytest.raises(Unreachable):
        await keeper.access("t", "team-a")
