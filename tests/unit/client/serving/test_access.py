from types import SimpleNamespace
from typing import Any

import pytest
from tests.support.scripted import ScriptedClient

from robotapp_client.serving.access import REMEMBER_S, Access, Caller, Gatekeeper, User, certified
from robotapp_client.serving.pages import caller
from robotapp_client.transport.errors import Unreachable

USER = {"username": "eve", "uid": "1", "groups": ["devs"], "extra": {"k": ["v"]}}
KNOWN = {"status": {"authenticated": True, "user": USER}}


def allowed(answer: bool) -> dict[str, Any]:
    return {"status": {"allowed": answer}}


def gatekeeper(*answers: Any) -> tuple[Gatekeeper, ScriptedClient]:
    client = ScriptedClient().script("create", *answers)
    return Gatekeeper(client, clock=client.clock), client


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
    assert await keeper.access(Caller(token="t"), "team-a") is access


async def test_the_review_asks_for_this_user_this_namespace_and_nothing_more() -> None:
    keeper, client = gatekeeper(KNOWN, allowed(True), allowed(True))
    await keeper.access(Caller(token="t"), "team-a")
    review = {"apiVersion": "authentication.k8s.io/v1", "kind": "TokenReview"}
    assert client.calls[0][2] == review | {"spec": {"token": "t"}}
    pods = client.calls[1][2]["spec"]
    assert (pods["user"], pods["groups"], pods["extra"]) == ("eve", ["devs"], {"k": ["v"]})
    assert pods["resourceAttributes"] == {"verb": "get", "resource": "pods", "namespace": "team-a"}
    assert client.calls[2][2]["spec"]["resourceAttributes"] == {"verb": "get", "resource": "nodes"}


@pytest.mark.parametrize(("header", "token"), [("Bearer abc ", "abc"), ("Bearer \udcff\udcfe", ""), ("Basic abc", "")])
def test_what_is_no_token_is_none(header: str, token: str) -> None:
    """Bytes that are no text come as lone surrogates, which nothing can hash or send on."""
    request = SimpleNamespace(transport=None, remote="192.0.2.1", headers={"Authorization": header})
    assert caller(request).token == token  # type: ignore[arg-type]
    assert Caller(token="\udcff").key


def test_a_certificate_is_no_other_ones_because_of_a_blank_in_its_name() -> None:
    one = certified(((("commonName", "alice"),), (("organizationName", "system:masters"),)))
    other = certified(((("commonName", "alice system:masters"),),))
    assert Caller(user=one).key != Caller(user=other).key


async def test_no_token_asks_nobody() -> None:
    keeper, client = gatekeeper()
    assert await keeper.access(Caller(), "team-a") is Access.UNKNOWN_CALLER
    assert client.calls == []


async def test_an_answer_is_remembered_for_some_seconds_per_namespace() -> None:
    keeper, client = gatekeeper(*[KNOWN, allowed(False)] * 3)
    for _ in range(3):
        await keeper.access(Caller(token="t"), "team-a")
    assert len(client.calls) == 2
    await keeper.access(Caller(token="t"), "team-b")
    assert len(client.calls) == 4
    client.now_s += REMEMBER_S
    await keeper.access(Caller(token="t"), "team-a")
    assert len(client.calls) == 6


async def test_without_an_api_server_nobody_is_let_in() -> None:
    keeper, _ = gatekeeper(Unreachable("down", maybe_applied=False))
    with pytest.raises(Unreachable):
        await keeper.access(Caller(token="t"), "team-a")


async def test_a_certificate_is_its_own_proof_so_only_its_rights_are_asked_for() -> None:
    keeper, client = gatekeeper(allowed(True), allowed(False))
    user = User("amy", ("tenants", "system:authenticated"))
    assert await keeper.access(Caller(user=user), "team-a") is Access.WITHOUT_NODES
    assert [call[2]["spec"]["user"] for call in client.calls] == ["amy", "amy"]
    assert client.calls[0][2]["spec"]["groups"] == ["tenants", "system:authenticated"]


async def test_a_path_is_asked_for_as_such_and_not_confused_with_a_namespace() -> None:
    keeper, client = gatekeeper(KNOWN, allowed(False), KNOWN, allowed(True), allowed(True))
    caller = Caller(token="t")
    assert await keeper.path(caller, "get", "/configz") is Access.FORBIDDEN
    assert client.calls[1][2]["spec"]["nonResourceAttributes"] == {"verb": "get", "path": "/configz"}
    assert await keeper.access(caller, "/configz") is Access.ALL


@pytest.mark.parametrize(
    ("subject", "user"),
    [
        ((), None),
        (None, None),
        (((("organizationName", "tenants"),),), None),
        (
            ((("organizationName", "a"),), (("organizationName", "b"),), (("commonName", "amy"),)),
            User("amy", ("a", "b", "system:authenticated")),
        ),
    ],
)
def test_a_subject_is_a_user_and_groups_as_the_api_server_reads_it(subject: object, user: User | None) -> None:
    assert certified(subject) == user
