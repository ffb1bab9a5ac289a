"""The testbed's own client, with a scripted connection in the server's place."""

import http.client
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robotapp_testbed import ApiStatusError
from robotapp_testbed.control_plane import api
from robotapp_testbed.control_plane.api import Api

Answer = tuple[int, Any] | Exception


class Server:
    """Answers in order, whatever the connection; an exception stands for a broken connection."""

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.requests: list[tuple[str, str, Any, dict[str, str]]] = []
        self.connections = 0
        self.now_s = 0.0
        self._answer: tuple[int, Any] = (200, {})

    def connect(self, *_: object, **__: object) -> "Server":
        self.connections += 1
        return self

    def request(self, method: str, path: str, *, body: str | None, headers: dict[str, str]) -> None:
        self.requests.append((method, path, json.loads(body) if body else None, headers))
        answer = self.answers.pop(0) if self.answers else (200, {})
        if isinstance(answer, Exception):
            raise answer
        self._answer = answer

    def getresponse(self) -> "Server":
        return self

    @property
    def status(self) -> int:
        return self._answer[0]

    def read(self) -> bytes:
        content = self._answer[1]
        return content.encode() if isinstance(content, str) else json.dumps(content).encode()

    def close(self) -> None:
        pass

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    made = Server()
    monkeypatch.setattr(api.ssl, "create_default_context", lambda **_: None)
    monkeypatch.setattr(api.http.client, "HTTPSConnection", made.connect)
    return made


@pytest.fixture
def client(server: Server) -> Iterator[Api]:
    made = Api(
        "https://127.0.0.1:1", ca_file=Path("ca"), token="secret", clock=lambda: server.now_s, sleep=server.sleep
    )
    yield made
    made.close()


def test_objects_go_and_come_as_json(server: Server, client: Api) -> None:
    server.answers = [(201, {"kind": "Node"})]
    assert client.create("/api/v1/nodes", {"metadata": {"name": "n"}}) == {"kind": "Node"}
    method, path, body, headers = server.requests[0]
    assert (method, path, body) == ("POST", "/api/v1/nodes", {"metadata": {"name": "n"}})
    assert headers["Authorization"] == "Bearer secret"
    assert headers["Content-Type"] == "application/json"


def test_a_patch_is_a_merge_patch(server: Server, client: Api) -> None:
    client.patch("/x", {"a": None})
    assert server.requests[0][3]["Content-Type"] == "application/merge-patch+json"


def test_text_stays_text(server: Server, client: Api) -> None:
    server.answers = [(200, "ok")]
    assert client.get("/readyz") == "ok"


@pytest.mark.parametrize(("content", "message"), [({"message": "taken"}, "taken"), ("plain trouble", "plain trouble")])
def test_an_error_carries_status_and_message(content: Any, message: str, server: Server, client: Api) -> None:
    server.answers = [(409, content)]
    with pytest.raises(ApiStatusError) as caught:
        client.delete("/x")
    assert (caught.value.status, caught.value.message) == (409, message)
    assert str(caught.value) == f"DELETE /x: 409 {message}"


def test_one_connection_serves_many_requests(server: Server, client: Api) -> None:
    for _ in range(3):
        client.get("/x")
    assert server.connections == 1


def test_a_connection_that_rested_is_replaced_before_the_server_closes_it(server: Server, client: Api) -> None:
    client.get("/x")
    server.now_s += 31
    client.create("/x", {})
    assert server.connections == 2


def test_a_read_survives_a_restart_of_the_server(server: Server, client: Api) -> None:
    client.get("/x")
    server.answers = [http.client.RemoteDisconnected("gone"), (200, {"again": True})]
    assert client.get("/x") == {"again": True}
    assert server.connections == 2


def test_a_write_is_never_repeated(server: Server, client: Api) -> None:
    client.get("/x")
    server.answers = [http.client.RemoteDisconnected("gone")]
    with pytest.raises(http.client.RemoteDisconnected):
        client.create("/x", {})
    assert [request[0] for request in server.requests] == ["GET", "POST"]


def test_without_a_server_a_read_fails_at_once(server: Server, client: Api) -> None:
    server.answers = [ConnectionRefusedError("refused"), ConnectionRefusedError("refused")]
    with pytest.raises(ConnectionRefusedError):
        client.get("/x")
    assert len(server.requests) == 1
    assert not client.is_ready()


def test_a_busy_server_is_asked_again(server: Server, client: Api) -> None:
    server.answers = [(429, "storage is (re)initializing")] * 3 + [(201, {"done": True})]
    assert client.create("/x", {}) == {"done": True}


def test_a_server_that_stays_busy_is_given_up(server: Server, client: Api) -> None:
    server.answers = [(429, "busy")] * 1000
    with pytest.raises(ApiStatusError, match="429 busy"):
        client.get("/x")
    assert server.now_s == pytest.approx(20, abs=1)


def test_ready_means_the_server_says_ok(server: Server, client: Api) -> None:
    server.answers = [(500, "not yet"), (200, "ok")]
    assert not client.is_ready()
    assert client.is_ready()


def test_the_first_error_of_many_is_raised(client: Api) -> None:
    def fail(item: int) -> None:
        if item == 3:
            raise ValueError(item)

    with pytest.raises(ValueError, match="3"):
        client.each(fail, range(5))
