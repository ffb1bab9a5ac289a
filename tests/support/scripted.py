"""Answers that are written in the test.

`ScriptedServer` plays them over a socket, byte by byte as written. `ScriptedClient` is a client without one, for logic
around writes, where order and errors matter.
"""

import asyncio
import json
from collections import defaultdict, deque
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NoReturn, Self, TypeVar
from urllib.parse import parse_qs

import msgspec
from tests.support.apiserver.verbs import target

from robotapp_client import ApiClient, Endpoint
from robotapp_client.api.bodies import APPLY
from robotapp_client.transport.errors import ClientError, Unreachable
from robotapp_client.transport.http11 import Permitted, always
from robotapp_client.transport.http_transport import Done, Response, Stream

T = TypeVar("T")
Play = Callable[[asyncio.StreamWriter], Awaitable[None]]
Answer = Any
"""A value to return, or an exception to raise, or a function of the path and the body that returns either."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A request as it arrived."""

    method: str
    path: str
    headers: dict[str, str]
    body: bytes

    @property
    def query(self) -> dict[str, str]:
        return {key: values[0] for key, values in parse_qs(self.path.partition("?")[2]).items()}


def reply(obj: Any, *, status: int = 200, headers: dict[str, str] | None = None) -> Play:
    """A complete JSON answer."""
    body = obj if isinstance(obj, bytes) else json.dumps(obj).encode()
    return raw(_head(status, {"Content-Length": str(len(body)), **(headers or {})}) + body)


def refusal(status: int, reason: str = "", *, headers: dict[str, str] | None = None, message: str = "no") -> Play:
    body = {"kind": "Status", "code": status, "reason": reason, "message": message}
    return reply(body, status=status, headers=headers)


def raw(data: bytes) -> Play:
    async def play(writer: asyncio.StreamWriter) -> None:
        writer.write(data)
        await writer.drain()

    return play


def hang_up(data: bytes = b"") -> Play:
    """Some bytes, then the end of the connection."""

    async def play(writer: asyncio.StreamWriter) -> None:
        writer.write(data)
        await writer.drain()
        writer.close()

    return play


def silence() -> Play:
    async def play(_writer: asyncio.StreamWriter) -> None:
        await asyncio.Event().wait()

    return play


def watch(*events: dict[str, Any] | bytes, then: str = "end") -> Play:
    """A watch that sends `events` (bytes go out as they are) and then "end"s, "hang"s, or is "cut" off."""

    async def play(writer: asyncio.StreamWriter) -> None:
        writer.write(_head(200, {"Transfer-Encoding": "chunked"}))
        for event in events:
            line = event if isinstance(event, bytes) else json.dumps(event, separators=(",", ":")).encode() + b"\n"
            writer.write(f"{len(line):x}\r\n".encode() + line + b"\r\n")
        await writer.drain()
        if then == "end":
            writer.write(b"0\r\n\r\n")
        elif then == "hang":
            await asyncio.Event().wait()
        else:
            writer.close()

    return play


def listing(version: int, *items: dict[str, Any], token: str = "") -> Play:
    meta = {"resourceVersion": str(version)} | ({"continue": token} if token else {})
    return reply({"metadata": meta, "items": list(items)})


def item(name: str, version: int, *, uid: str = "", namespace: str = "default", **more: Any) -> dict[str, Any]:
    meta = {"name": name, "namespace": namespace, "uid": uid or f"uid-{name}", "resourceVersion": str(version)}
    return {"metadata": meta, **more}


def event(kind: str, obj: dict[str, Any]) -> dict[str, Any]:
    return {"type": kind, "object": obj}


def bookmark(version: int, *, initial_end: bool = False) -> dict[str, Any]:
    meta: dict[str, Any] = {"resourceVersion": str(version)}
    if initial_end:
        meta["annotations"] = {"k8s.io/initial-events-end": "true"}
    return event("BOOKMARK", {"kind": "ConfigMap", "metadata": meta})


def error_event(code: int, reason: str = "", **more: Any) -> dict[str, Any]:
    return event("ERROR", {"kind": "Status", "code": code, "reason": reason, "message": "no", **more})


def _head(status: int, headers: dict[str, str]) -> bytes:
    lines = [f"HTTP/1.1 {status} X", "Content-Type: application/json", *(f"{k}: {v}" for k, v in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode()


class ScriptedServer:
    """Plays `script` in order, one item per request whatever the connection, then `otherwise`: silence if not given.

    `newest`: version of the server, or the versions it has one after the other, the last one for ever. With it lists of one object, by which mirrors learn that version, are no part of the script.
    """

    def __init__(self, *script: Play, otherwise: Play | None = None, newest: int | Sequence[int] | None = None) -> None:
        self.newest = [newest] if isinstance(newest, int) else list(newest or ())
        self.version_queries: list[dict[str, str]] = []
        self.script = list(script)
        self.otherwise = otherwise or silence()
        self.seen: list[Seen] = []
        self.connections = 0
        self._tasks: set[asyncio.Task[None]] = set()
        self.endpoint = Endpoint("")

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        self.endpoint = Endpoint(f"http://127.0.0.1:{self._server.sockets[0].getsockname()[1]}")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        self.connections += 1
        try:
            while not writer.is_closing():
                seen = await self._read(reader)
                if self.newest and seen.query.get("limit") == "1":
                    self.version_queries.append(seen.query)
                    await listing(self.newest.pop(0) if len(self.newest) > 1 else self.newest[0])(writer)
                    continue
                self.seen.append(seen)
                play = self.script.pop(0) if self.script else self.otherwise
                await play(writer)
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            pass
        finally:
            self._tasks.discard(task)
            writer.close()

    @staticmethod
    async def _read(reader: asyncio.StreamReader) -> Seen:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
        method, path, _ = head[0].split(" ")
        headers = dict(line.split(": ", 1) for line in head[1:] if line)
        body = await reader.readexactly(int(headers.get("Content-Length", "0")))
        return Seen(method, path, headers, body)


class ScriptedTransport:
    """Answers requests in order from a script per verb, else always the same, and records them.

    `calls` are (verb, path, body). Bodies are decoded, but for `post_raw` and `post_soon`, which are sent as bytes.
    """

    def __init__(self) -> None:
        self.calls: list[tuple[str, str, Any]] = []
        self.scripts: defaultdict[str, deque[Answer]] = defaultdict(deque)
        self.fallback: dict[str, Answer] = {}

    async def open(self) -> None: ...
    async def close(self) -> None: ...

    async def request(
        self,
        method: str,
        path: str,
        *,
        body: bytes | None = None,
        content_type: str = "",
        timeout_s: float,
        permitted: Permitted = always,
        most_bytes: int = 0,
    ) -> Response:
        del timeout_s, most_bytes
        address, _, query = path.partition("?")
        sent = msgspec.json.decode(body) if body else None
        match method:
            case "PATCH" if content_type == APPLY:
                assert "force=true" in query, "our writers own what they apply"
                return self._answer("apply", address, sent, permitted)
            case "PATCH":
                return self._answer("patch", address, (content_type, sent), permitted)
            case "DELETE":
                return self._answer("delete", address, _delete_conditions(sent or {}), permitted)
            case "POST" if target(address).subresource:
                return self._answer("post_raw", address, body, permitted)
        return self._answer({"GET": "get", "POST": "create"}[method], address, sent, permitted)

    def post(
        self, path: str, body: bytes, done: Done, *, content_type: str, timeout_s: float, permitted: Permitted
    ) -> None:
        """Answered at once."""
        del content_type, timeout_s
        try:
            outcome: Response | ClientError = self._answer("post_soon", path, body, permitted)
        except ClientError as error:
            outcome = error
        done(outcome)

    def stream(self, path: str, *, silence_s: float) -> AbstractAsyncContextManager[Stream]:
        raise NotImplementedError(f"watches need a server: {path}, {silence_s}")

    def _answer(self, verb: str, path: str, body: Any, permitted: Permitted) -> Response:
        if not permitted():
            raise Unreachable("not permitted", maybe_applied=False)
        self.calls.append((verb, path, body))
        script = self.scripts[verb]
        answer = script.popleft() if script else self.fallback.get(verb, _fail)
        if callable(answer):
            answer = answer(path, body)
        if isinstance(answer, BaseException):
            raise answer
        return Response(200, answer if isinstance(answer, bytes) else msgspec.json.encode(answer), [])


class ScriptedClient(ApiClient):
    """An ApiClient on a ScriptedTransport, in a time that only its pauses move. Reads are not repeated."""

    def __init__(self) -> None:
        transport = ScriptedTransport()
        self.script_of = transport.scripts
        self.fallback = transport.fallback
        self.calls = transport.calls
        self.slept_s: list[float] = []
        self.now_s = 0.0
        super().__init__(
            Endpoint("scripted"),
            user_agent="test",
            field_manager="test",
            transport=transport,
            clock=lambda: self.now_s,
            sleep=self._pause,
            uniform=lambda: 0.0,
        )

    def script(self, verb: str, *answers: Answer) -> Self:
        self.script_of[verb].extend(answers)
        return self

    def always(self, verb: str, answer: Answer) -> Self:
        self.fallback[verb] = answer
        return self

    def methods(self) -> list[str]:
        return [verb for verb, _, _ in self.calls]

    async def read(self, path: str, decode: Callable[[bytes], T]) -> T:
        return decode((await self.request("GET", path)).body)

    async def _pause(self, seconds: float) -> None:
        self.slept_s.append(seconds)
        self.now_s += seconds


def _delete_conditions(options: dict[str, Any]) -> dict[str, Any]:
    preconditions = options.get("preconditions") or {}
    wanted = {name: preconditions.get(name) for name in ("uid", "resourceVersion")}
    return wanted | {"propagation": options.get("propagationPolicy")}


def _fail(path: str, _: Any) -> NoReturn:
    raise AssertionError(f"unexpected request to {path}")
