"""The verbs, against a server that answers as scripted."""

import json
from typing import Any

import msgspec
import pytest
from tests.support.clients import FakeTime, client_for, configmap, posted_soon
from tests.support.scripted import ScriptedServer, hang_up, item, listing, raw, refusal, reply, silence

from robotapp_client import Conflict, Forbidden, Gone, NotFound, ServerError, TooManyRequests, Unreachable
from robotapp_client.api.bodies import JSON_PATCH
from robotapp_client.api.client import MOST_PAGE_BYTES, ApiClient
from robotapp_client.api.resources import CONFIGMAPS, NODES, PODS, ROBOTAPPS, ROBOTCLAIMS
from robotapp_client.transport.errors import AlreadyExists, TooLong

BROKEN = b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\n{"


class Meta(msgspec.Struct, rename="camel"):
    name: str
    resource_version: str


class Slim(msgspec.Struct):
    metadata: Meta


def patient(server: ScriptedServer, time: FakeTime) -> ApiClient:
    return client_for(server.endpoint, **time.settings)


async def test_a_get_is_a_quorum_read_with_our_name_on_it() -> None:
    async with ScriptedServer(reply(item("a", 5))) as server, client_for(server.endpoint) as client:
        assert (await client.get(CONFIGMAPS, "a", namespace="default"))["metadata"]["name"] == "a"
    seen = server.seen[0]
    assert (seen.method, seen.path) == ("GET", "/api/v1/namespaces/default/configmaps/a")
    assert seen.headers["User-Agent"] == "robotapp-test"
    assert seen.headers["Accept"] == "application/json"
    assert "Accept-Encoding" not in seen.headers


async def test_objects_are_decoded_into_the_type_asked_for() -> None:
    script = [reply(item("a", 5)), listing(9, item("b", 7))]
    async with ScriptedServer(*script) as server, client_for(server.endpoint) as client:
        got = await client.get(PODS, "a", namespace="default", as_type=Slim)
        found = await client.list(PODS, as_type=Slim)
    assert got.metadata.resource_version == "5"
    assert [pod.metadata.name for pod in found.items] == ["b"]
    assert found.resource_version == "9"


@pytest.mark.parametrize("levels", [1500, 100_000])
async def test_an_object_that_a_tenant_nested_without_end_is_read_and_written_like_any_other(levels: int) -> None:
    deep = '{"a":' * levels + "1" + "}" * levels
    body = f'{{"metadata": {{"name": "a", "resourceVersion": "5"}}, "spec": {deep}}}'.encode()
    answer = reply(body)
    async with ScriptedServer(*[answer] * 3) as server, client_for(server.endpoint) as client:
        typed = await client.get(PODS, "a", namespace="default", as_type=Slim)
        plain = await client.get(PODS, "a", namespace="default")
        written = await client.patch(PODS, "a", {"metadata": {}}, namespace="default")
    assert typed.metadata.resource_version == "5"
    assert plain["metadata"] == written["metadata"] == {"name": "a", "resourceVersion": "5"}


async def test_a_list_is_read_page_by_page_with_its_selectors() -> None:
    script = [listing(9, item("a", 1), token="t 1"), listing(9, item("b", 2))]
    async with ScriptedServer(*script) as server, client_for(server.endpoint) as client:
        found = await client.list(PODS, namespace="n", label_selector="a=b,c in (d)", field_selector="x=y", page=1)
    assert [pod["metadata"]["name"] for pod in found.items] == ["a", "b"]
    selectors = {"labelSelector": "a=b,c in (d)", "fieldSelector": "x=y"}
    assert [seen.query for seen in server.seen] == [
        {"limit": "1", **selectors},
        {"limit": "1", "continue": "t 1", **selectors},
    ]


async def test_an_expired_continue_token_starts_the_list_again_and_then_without_pages() -> None:
    script = [
        listing(9, item("a", 1), token="t"),
        refusal(410, "Expired"),
        listing(10, item("a", 1), token="u"),
        refusal(410, "Expired"),
        listing(11, item("a", 1), item("b", 2)),
    ]
    async with ScriptedServer(*script) as server, client_for(server.endpoint) as client:
        found = await client.list(PODS, page=1)
    assert (len(found.items), found.resource_version) == (2, "11")
    assert server.seen[-1].query == {}


def large(name: str, version: int) -> dict[str, Any]:
    """An object as large as etcd takes one."""
    return item(name, version) | {"data": {"a": "x" * (MOST_PAGE_BYTES // 10)}}


async def test_a_page_that_is_longer_than_our_memory_allows_is_read_in_smaller_ones() -> None:
    names = [f"a{index}" for index in range(12)]
    objects = [large(name, index) for index, name in enumerate(names)]
    script = [listing(9, *objects), listing(9, *objects[:3], token="t"), listing(9, *objects[3:9], token="u")]
    async with ScriptedServer(*script, listing(9, *objects[9:])) as server, client_for(server.endpoint) as client:
        found = await client.list(CONFIGMAPS, page=12, as_type=Slim)
    assert [each.metadata.name for each in found.items] == names
    assert [(seen.query["limit"], seen.query.get("continue")) for seen in server.seen] == [
        ("12", None),
        ("3", None),
        ("6", "t"),
        ("12", "u"),
    ], "a fourth of what was too long, then twice as many with every page that was not"


async def test_a_read_is_refused_that_is_longer_than_its_reader_takes() -> None:
    async with ScriptedServer(reply({"a": "x" * 100_000}), reply({})) as server, client_for(server.endpoint) as client:
        with pytest.raises(TooLong, match="GET /x: the answer is longer than 50000 bytes"):
            await client.read("/x", bytes, most_bytes=50_000)
        assert await client.read("/x", bytes, most_bytes=50_000) == b"{}", "over another connection"
    assert len(server.seen) == 2


async def test_of_each_object_is_kept_what_the_caller_wants() -> None:
    script = [
        listing(9, item("a", 1), token="t"),
        refusal(410, "Expired"),
        listing(10, item("b", 1), token="u"),
        listing(10, item("c", 2)),
    ]

    def without_version(pod: Slim) -> Slim:
        return Slim(Meta(pod.metadata.name, ""))

    async with ScriptedServer(*script) as server, client_for(server.endpoint) as client:
        found = await client.list(PODS, page=1, as_type=Slim, keep=without_version)
    assert found.items == [Slim(Meta("b", "")), Slim(Meta("c", ""))]


async def test_a_list_that_is_gone_even_without_pages_is_an_error() -> None:
    script = [refusal(410, "Expired")] * 3
    async with ScriptedServer(*script) as server, client_for(server.endpoint) as client:
        with pytest.raises(Gone):
            await client.list(PODS)


async def test_null_items_are_an_empty_list() -> None:
    empty = reply({"metadata": {"resourceVersion": "3"}, "items": None})
    async with ScriptedServer(empty) as server, client_for(server.endpoint) as client:
        assert (await client.list(PODS)).items == []


@pytest.mark.parametrize(
    "failure",
    [hang_up(), hang_up(BROKEN), refusal(503), refusal(500), refusal(504), refusal(429), reply(b'{"half')],
    ids=["closed", "truncated", "503", "500", "504", "429", "garbled"],
)
async def test_reads_are_repeated(failure: Any) -> None:
    time = FakeTime()
    async with ScriptedServer(failure, failure, reply(item("a", 1))) as server, patient(server, time) as client:
        await client.get(NODES, "a")
    assert len(server.seen) == 3
    assert time.slept == [0.1, 0.2]


async def test_a_server_that_asks_for_patience_gets_it() -> None:
    time = FakeTime()
    script = [refusal(429, headers={"Retry-After": "3"}), reply(item("a", 1))]
    async with ScriptedServer(*script) as server, patient(server, time) as client:
        await client.get(NODES, "a")
    assert time.slept == [3]


async def test_reads_give_up_in_the_end() -> None:
    time = FakeTime()
    async with ScriptedServer(*[refusal(503)] * 9) as server, patient(server, time) as client:
        with pytest.raises(ServerError):
            await client.get(NODES, "a")
    assert len(server.seen) == 4


async def test_reads_do_not_wait_for_minutes() -> None:
    time = FakeTime()
    async with ScriptedServer(refusal(429, headers={"Retry-After": "600"})) as server, patient(server, time) as client:
        with pytest.raises(TooManyRequests):
            await client.get(NODES, "a")
    assert time.slept == []


async def test_refusals_are_not_repeated() -> None:
    async with ScriptedServer(refusal(404, "NotFound"), refusal(403)) as server, client_for(server.endpoint) as client:
        with pytest.raises(NotFound):
            await client.get(NODES, "a")
        with pytest.raises(Forbidden):
            await client.list(NODES)
    assert len(server.seen) == 2


async def test_an_object_that_does_not_fit_its_type_is_not_read_again() -> None:
    async with ScriptedServer(reply({"metadata": {"name": 7}})) as server, client_for(server.endpoint) as client:
        with pytest.raises(msgspec.ValidationError):
            await client.get(NODES, "a", as_type=Slim)
    assert len(server.seen) == 1


WRITES = {
    "create": lambda client: client.create(CONFIGMAPS, configmap("a")),
    "replace": lambda client: client.replace(CONFIGMAPS, configmap("a")),
    "patch": lambda client: client.patch(CONFIGMAPS, "a", {}, namespace="default"),
    "apply": lambda client: client.apply(CONFIGMAPS, configmap("a")),
    "delete": lambda client: client.delete(CONFIGMAPS, "a", namespace="default"),
    "post_raw": lambda client: client.post_raw("/api/v1/namespaces/default/pods/a/binding", b"{}"),
    "post_soon": lambda client: posted_soon(client, "/api/v1/namespaces/default/pods/a/binding", b"{}"),
}


@pytest.mark.parametrize("write", WRITES.values(), ids=WRITES.keys())
@pytest.mark.parametrize(
    "failure",
    [hang_up(), hang_up(BROKEN), refusal(503), refusal(429, headers={"Retry-After": "0"})],
    ids=["closed", "truncated", "503", "429"],
)
async def test_writes_are_sent_once_even_over_a_connection_that_was_used_before(write: Any, failure: Any) -> None:
    # HTTP libraries like to repeat PUT and DELETE when a kept-alive connection breaks: not for us.
    async with ScriptedServer(reply(item("w", 1)), failure, reply(item("a", 1))) as server:
        async with client_for(server.endpoint) as client:
            await client.get(NODES, "warm-up")
            with pytest.raises((Unreachable, ServerError, TooManyRequests)) as caught:
                await write(client)
        assert server.connections == 1
    assert len(server.seen) == 2
    assert caught.value.maybe_applied is not isinstance(caught.value, TooManyRequests)


async def test_a_write_that_could_not_be_sent_was_not_applied() -> None:
    async with ScriptedServer() as server:
        endpoint = server.endpoint
    async with client_for(endpoint) as client:
        with pytest.raises(Unreachable) as caught:
            await client.create(CONFIGMAPS, configmap("a"))
    assert not caught.value.maybe_applied
    assert client.requests == {("POST", 0): 1}


async def test_a_write_without_an_answer_in_time_may_have_been_applied() -> None:
    async with ScriptedServer(silence()) as server, client_for(server.endpoint, timeout_s=0.05) as client:
        with pytest.raises(Unreachable) as caught:
            await client.replace(CONFIGMAPS, configmap("a"))
    assert caught.value.maybe_applied


@pytest.mark.parametrize("body", [b"", b"null", b"[]", b'{"a'])
async def test_a_write_answered_with_nonsense_may_have_been_applied(body: bytes) -> None:
    async with ScriptedServer(reply(body)) as server, client_for(server.endpoint) as client:
        with pytest.raises(Unreachable) as caught:
            await client.patch(CONFIGMAPS, "a", {}, namespace="default")
    assert caught.value.maybe_applied


async def test_bodies_carry_kind_and_version_and_say_who_writes() -> None:
    async with ScriptedServer(*[reply(item("a", 1))] * 4) as server, client_for(server.endpoint) as client:
        await client.create(ROBOTCLAIMS, {"metadata": {"name": "dds.default.c.7"}})
        await client.replace(ROBOTAPPS, {"metadata": {"name": "a", "namespace": "n"}}, subresource="status")
        await client.patch(ROBOTAPPS, "a", {"x": 1}, namespace="n")
        await client.patch(ROBOTAPPS, "a", [{"op": "test"}], namespace="n", content_type=JSON_PATCH)
    assert [(seen.method, seen.path, seen.headers["Content-Type"]) for seen in server.seen] == [
        ("POST", "/apis/robotics.io/v1alpha1/robotclaims?fieldManager=robotapp-test", "application/json"),
        (
            "PUT",
            "/apis/robotics.io/v1alpha1/namespaces/n/robotapps/a/status?fieldManager=robotapp-test",
            "application/json",
        ),
        (
            "PATCH",
            "/apis/robotics.io/v1alpha1/namespaces/n/robotapps/a?fieldManager=robotapp-test",
            "application/merge-patch+json",
        ),
        (
            "PATCH",
            "/apis/robotics.io/v1alpha1/namespaces/n/robotapps/a?fieldManager=robotapp-test",
            "application/json-patch+json",
        ),
    ]
    body = json.loads(server.seen[0].body)
    assert (body["apiVersion"], body["kind"]) == ("robotics.io/v1alpha1", "RobotClaim")


async def test_an_apply_is_json_without_managed_fields() -> None:
    obj = configmap("a", x="1")
    obj["metadata"] |= {"managedFields": [{}], "resourceVersion": "5"}
    async with ScriptedServer(reply(obj), reply(obj)) as server, client_for(server.endpoint) as client:
        await client.apply(CONFIGMAPS, obj)
        await client.apply(CONFIGMAPS, obj, force=False, subresource="status")
    assert server.seen[0].headers["Content-Type"] == "application/apply-patch+yaml"
    assert server.seen[0].query == {"fieldManager": "robotapp-test", "force": "true"}
    assert server.seen[1].path.startswith("/api/v1/namespaces/default/configmaps/a/status?")
    assert server.seen[1].query["force"] == "false"
    assert json.loads(server.seen[0].body)["metadata"] == {"name": "a", "namespace": "default", "resourceVersion": "5"}
    assert "managedFields" in obj["metadata"]


async def test_only_named_managers_apply() -> None:
    async with ScriptedServer() as server, client_for(server.endpoint, field_manager="") as client:
        with pytest.raises(ValueError, match="field_manager"):
            await client.apply(CONFIGMAPS, configmap("a"))


async def test_deletes_carry_their_preconditions() -> None:
    async with ScriptedServer(*[reply({})] * 3) as server, client_for(server.endpoint) as client:
        await client.delete(NODES, "a")
        await client.delete(NODES, "a", uid="u", resource_version="5")
        await client.delete(NODES, "a", propagation="Foreground")
    assert server.seen[0].body == b""
    assert json.loads(server.seen[1].body)["preconditions"] == {"uid": "u", "resourceVersion": "5"}
    assert json.loads(server.seen[2].body)["propagationPolicy"] == "Foreground"


async def test_raw_bytes_go_out_and_come_back_untouched() -> None:
    async with ScriptedServer(reply(b'{"any": "thing"}', status=201)) as server, client_for(server.endpoint) as client:
        assert await client.post_raw("/api/v1/x", b'{ "a":1}') == b'{"any": "thing"}'
    assert (server.seen[0].path, server.seen[0].body) == ("/api/v1/x", b'{ "a":1}')


async def test_a_post_without_a_waiting_task_is_counted_and_told_its_end_once() -> None:
    async with ScriptedServer(reply({}, status=201), refusal(409, "AlreadyExists")) as server:
        async with client_for(server.endpoint) as client:
            await posted_soon(client, "/x", b'{ "a":1}')
            with pytest.raises(AlreadyExists):
                await posted_soon(client, "/x", b"{}")
        with pytest.raises(Unreachable, match="closed") as caught:
            await posted_soon(client, "/x", b"{}")
    assert not caught.value.maybe_applied
    assert client.requests == {("POST", 201): 1, ("POST", 409): 1, ("POST", 0): 1}
    assert [(seen.method, seen.path, seen.body) for seen in server.seen] == [
        ("POST", "/x", b'{ "a":1}'),
        ("POST", "/x", b"{}"),
    ]


async def test_redirects_are_not_followed_with_our_token() -> None:
    moved = refusal(302, headers={"Location": "http://127.0.0.1:1/"})
    async with ScriptedServer(moved) as server, client_for(server.endpoint) as client:
        with pytest.raises(Exception, match="no") as caught:
            await client.get(NODES, "a")
    assert caught.value.status == 302  # type: ignore[attr-defined]


async def test_requests_are_counted_by_method_and_status() -> None:
    script = [reply(item("a", 1)), refusal(409, "Conflict"), raw(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}")]
    async with ScriptedServer(*script) as server, client_for(server.endpoint) as client:
        await client.get(NODES, "a")
        with pytest.raises(Conflict):
            await client.replace(NODES, item("a", 1))
        await client.delete(NODES, "a")
        assert client.requests == {("GET", 200): 1, ("PUT", 409): 1, ("DELETE", 200): 1}
        assert "3 requests" in repr(client)
