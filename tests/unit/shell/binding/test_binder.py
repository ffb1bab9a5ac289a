from typing import Any

import msgspec
import pytest
from tests.support.scripted import ScriptedClient

from robotapp_client.transport.errors import (
    ClientError,
    Conflict,
    Forbidden,
    NamespaceTerminating,
    NotFound,
    ServerError,
    TooManyRequests,
    Unreachable,
)
from robotapp_scheduler.core.api.core_v1 import Metadata, Pod, PodSpec
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult
from robotapp_scheduler.shell.binding.binder import MOST_DOUBT_DELAY_S, Binder

PATH = "/api/v1/namespaces/team-a/pods/drv-0/binding"


def pod(*, uid: str = "u1", node: str = "", version: str = "7", deleting: bool = False) -> Pod:
    meta = Metadata(
        name="drv-0",
        namespace="team-a",
        uid=uid,
        resource_version=version,
        deletion_timestamp="2026-01-01T00:00:00Z" if deleting else None,
    )
    return Pod(metadata=meta, spec=PodSpec(node_name=node))


def conflict() -> Conflict:
    return Conflict("already assigned", status=409, reason="Conflict")


def no_pod() -> NotFound:
    return NotFound('pods "drv-0" not found', status=404, reason="NotFound")


def server_error(status: int) -> ServerError:
    return ServerError("boom", status=status)


async def bind(client: ScriptedClient, **options: Any) -> BindOutcome:
    binder = Binder(client, sleep=client.sleep, uniform=lambda: 0.0)
    return await binder.bind(pod(), "edge-1", **options)


async def test_the_binding_names_pod_uid_and_node_and_nothing_else() -> None:
    client = ScriptedClient().script("post_raw", b"")
    assert await bind(client) == BindOutcome(BindResult.BOUND, node="edge-1")
    assert client.calls[0][1] == PATH
    assert msgspec.json.decode(client.calls[0][2]) == {
        "apiVersion": "v1",
        "kind": "Binding",
        "metadata": {"name": "drv-0", "namespace": "team-a", "uid": "u1"},
        "target": {"apiVersion": "v1", "kind": "Node", "name": "edge-1"},
    }


async def test_grants_and_the_version_they_were_decided_on_travel_in_the_binding() -> None:
    client = ScriptedClient().script("post_raw", b"")
    await bind(client, annotations={"granted.robotics.io/devices": "can-can0"}, resource_version="7")
    metadata = msgspec.json.decode(client.calls[0][2])["metadata"]
    assert metadata["resourceVersion"] == "7"
    assert metadata["annotations"] == {"granted.robotics.io/devices": "can-can0"}


@pytest.mark.parametrize(
    ("first", "waits"),
    [
        (server_error(500), [0.01]),
        (server_error(503), [0.01]),
        (Unreachable("refused", maybe_applied=False), [0.01]),
        (TooManyRequests("slow", status=429, retry_after_s=2.0), [2.0, 0.01]),
    ],
)
async def test_what_surely_or_probably_was_not_applied_is_tried_again(first: ClientError, waits: list[float]) -> None:
    client = ScriptedClient().script("post_raw", first, b"")
    assert (await bind(client)).result is BindResult.BOUND
    assert client.slept_s == waits


async def test_four_tries_with_growing_delays_then_the_pod_is_read() -> None:
    client = ScriptedClient().always("post_raw", server_error(500)).always("get", pod())
    assert (await bind(client)).result is BindResult.FAILED
    assert client.methods() == ["post_raw"] * 4 + ["get"]
    assert client.slept_s == pytest.approx([0.01, 0.05, 0.25])


@pytest.mark.parametrize("error", [Unreachable("reset", maybe_applied=True), server_error(504), conflict()])
@pytest.mark.parametrize(
    ("found", "result"),
    [
        (pod(node="edge-1"), BindResult.BOUND),
        (pod(node="edge-2"), BindResult.TAKEN),
        (pod(node="edge-1", deleting=True), BindResult.BOUND),
        (pod(deleting=True), BindResult.GONE),
        (pod(uid="other", node="edge-1"), BindResult.GONE),
        (pod(version="8"), BindResult.CHANGED),
        (pod(), BindResult.FAILED),
        (no_pod(), BindResult.GONE),
    ],
)
async def test_after_an_unclear_answer_the_stored_pod_decides(
    error: ClientError, found: Any, result: BindResult
) -> None:
    client = ScriptedClient().script("post_raw", error).script("get", found)
    assert (await bind(client)).result is result
    assert client.methods() == ["post_raw", "get"]


async def test_a_deleted_pod_is_gone() -> None:
    client = ScriptedClient().script("post_raw", no_pod()).script("get", no_pod())
    assert (await bind(client)).result is BindResult.GONE


async def test_a_proxys_404_does_not_mean_that_the_pod_is_gone() -> None:
    proxys = NotFound("404 page not found", status=404)
    client = ScriptedClient().script("post_raw", proxys).script("get", proxys, pod(node="edge-1"))
    assert (await bind(client)).result is BindResult.BOUND
    client = ScriptedClient().script("post_raw", proxys).always("get", proxys)
    assert (await bind(client)).result is BindResult.FAILED


async def test_a_refusal_is_reported_with_the_servers_words_and_not_repeated() -> None:
    client = ScriptedClient().script("post_raw", Forbidden("policy says no", status=403))
    assert await bind(client) == BindOutcome(BindResult.FAILED, "policy says no")


async def test_while_the_pod_cannot_be_read_the_outcome_stays_failed_with_both_reasons() -> None:
    client = ScriptedClient().script("post_raw", conflict()).always("get", Unreachable("down", maybe_applied=False))
    outcome = await bind(client)
    assert outcome.result is BindResult.FAILED
    assert "already assigned" in outcome.message
    assert "down" in outcome.message


async def test_a_bind_that_may_have_been_applied_is_looked_at_until_there_is_an_answer() -> None:
    away = [Unreachable("refused", maybe_applied=False)] * 600
    client = ScriptedClient().script("post_raw", Unreachable("reset", maybe_applied=True))
    client.script("get", *away, pod(node="edge-1"))
    assert await bind(client) == BindOutcome(BindResult.BOUND, node="edge-1")
    assert max(client.slept_s) == MOST_DOUBT_DELAY_S


async def test_a_bind_that_was_surely_not_applied_fails_when_the_pod_cannot_be_read() -> None:
    refused = Unreachable("refused", maybe_applied=False)
    client = ScriptedClient().always("post_raw", refused).always("get", refused)
    assert (await bind(client)).result is BindResult.FAILED


async def test_a_500_before_a_conflict_leaves_the_bind_in_doubt() -> None:
    client = ScriptedClient().script("post_raw", server_error(500), conflict())
    client.script("get", *[server_error(503)] * 20, pod(node="edge-1"))
    assert (await bind(client)).result is BindResult.BOUND


@pytest.mark.parametrize("told", [0, 1, 2, 3])
async def test_who_leads_no_longer_sends_and_says_nothing_more(told: int) -> None:
    """Asked before an attempt, in the moment of sending, before the next attempt, and between two looks."""
    answers = iter([True] * told)
    client = ScriptedClient().always("post_raw", server_error(504)).always("get", server_error(503))
    binder = Binder(
        client,
        permitted=lambda: next(answers, False),
        sleep=client.sleep,
        uniform=lambda: 0.0,
    )
    assert (await binder.bind(pod(), "edge-1")).result is BindResult.DEPOSED
    assert client.methods().count("post_raw") == (told >= 2)
    assert client.methods().count("get") == (told >= 3)


@pytest.mark.parametrize(
    ("first", "then", "found", "result", "calls"),
    [
        (b"", None, None, None, ["post_soon"]),
        (server_error(503), b"", None, BindResult.BOUND, ["post_soon", "post_raw"]),
        (conflict(), None, pod(node="edge-2"), BindResult.TAKEN, ["post_soon", "get"]),
        (Unreachable("reset", maybe_applied=True), None, pod(node="edge-1"), BindResult.BOUND, ["post_soon", "get"]),
        (Forbidden("no", status=403), None, None, BindResult.FAILED, ["post_soon"]),
        (NamespaceTerminating("ends", status=403), None, None, BindResult.GONE, ["post_soon"]),
    ],
    ids=["bound", "503", "conflict", "doubt", "refused", "namespace ends"],
)
async def test_a_bind_begun_without_a_task_goes_on_where_its_first_try_ended(
    first: Any, then: Any, found: Any, result: BindResult | None, calls: list[str]
) -> None:
    client = ScriptedClient().script("post_soon", first).script("post_raw", then).script("get", found)
    binder = Binder(client, sleep=client.sleep, uniform=lambda: 0.0)
    told: list[ClientError | None] = []
    binder.send(pod(), "edge-1", told.append)
    (error,) = told
    if error is not None:
        outcome = await binder.bind(pod(), "edge-1", refused=error)
        assert outcome.result is result
    assert client.methods() == calls
    assert msgspec.json.decode(client.calls[0][2])["target"]["name"] == "edge-1"


async def test_what_is_not_permitted_any_more_is_not_sent_and_is_deposed() -> None:
    client = ScriptedClient()
    binder = Binder(client, permitted=lambda: False, sleep=client.sleep, uniform=lambda: 0.0)
    told: list[ClientError | None] = []
    binder.send(pod(), "edge-1", told.append)
    (error,) = told
    assert isinstance(error, Unreachable)
    assert (await binder.bind(pod(), "edge-1", refused=error)).result is BindResult.DEPOSED
    assert client.calls == []
