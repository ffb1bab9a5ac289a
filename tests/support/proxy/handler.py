"""One component's requests: asks for the fault, forwards, acts the fault out."""

import asyncio
import json
import socket
import struct
from collections.abc import AsyncIterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

import aiohttp
from aiohttp import web
from tests.support.proxy.calls import Call, parse
from tests.support.proxy.faults import Fault, Reply
from tests.support.proxy.ledger import Ledger, Moment, Write
from tests.support.proxy.streams import OpenWatch, forward
from yarl import URL

from robotapp_client.transport.kubeconfig import Endpoint

_HOP = frozenset(
    {"connection", "keep-alive", "transfer-encoding", "content-length", "upgrade", "te", "trailer", "host"}
)


class Desk(Protocol):
    """What a handler needs of the proxy."""

    ledger: Ledger

    def pick(self, call: Call) -> Fault: ...
    def notify(self, write: Write, moment: Moment) -> None: ...
    def opened(self, call: Call) -> AbstractContextManager[OpenWatch]: ...


@dataclass(frozen=True, slots=True)
class Handler:
    """One component's requests."""

    proxy: Desk
    component: str
    endpoint: Endpoint
    session: aiohttp.ClientSession

    async def __call__(self, request: web.BaseRequest) -> web.StreamResponse:
        call = parse(self.component, request.method, request.raw_path, request.headers, await request.read())
        fault = self.proxy.pick(call)
        if fault.delay_s:
            await asyncio.sleep(fault.delay_s)
        if call.verb == "watch" and fault.forward and fault.reply is Reply.PASS:
            return await self._watch(request, call, fault)
        write = self.proxy.ledger.enter(call) if call.is_write else None
        if write is not None:
            write.fault = "" if fault.name == "pass" else fault.name
            self.proxy.notify(write, Moment.BEFORE)
            if write.fault == "killed before":
                return _break_off(request)
        if not fault.forward:
            return await self._reply(request, fault, None, write)
        try:
            upstream = await self._forward(request, call)
        except aiohttp.ClientError:
            return _break_off(request)
        if write is not None:
            write.status = upstream.status
            self.proxy.notify(write, Moment.AFTER)
            if write.fault == "killed after":
                return _break_off(request)
        return await self._reply(request, fault, upstream, write)

    async def _forward(self, request: web.BaseRequest, call: Call) -> "_Answer":
        async with self.session.request(
            call.method, self._url(call), data=call.body or None, headers=await self._headers(request)
        ) as response:
            return _Answer(response.status, _passed(response.headers), await response.read())

    async def _watch(self, request: web.BaseRequest, call: Call, fault: Fault) -> web.StreamResponse:
        headers = await self._headers(request)
        headers.pop("Accept-Encoding", None)
        try:
            async with self.session.get(self._url(call), headers=headers) as response:
                if response.status != 200:
                    return web.Response(
                        status=response.status, headers=_passed(response.headers), body=await response.read()
                    )
                out = web.StreamResponse(status=200, headers=_passed(response.headers))
                await out.prepare(request)
                with self.proxy.opened(call) as watch:
                    await forward(watch, _lines(response), out, fault)
                return out
        except (aiohttp.ClientError, ConnectionError):
            return _break_off(request)

    async def _reply(
        self, request: web.BaseRequest, fault: Fault, upstream: "_Answer | None", write: Write | None
    ) -> web.StreamResponse:
        if fault.reply in (Reply.CLOSE, Reply.RESET):
            return _break_off(request, reset=fault.reply is Reply.RESET)
        if fault.reply is Reply.STATUS:
            upstream = _refusal(fault)
        assert upstream is not None
        if write is not None:
            write.answered = upstream.status
        if fault.reply is Reply.GARBLE:
            return web.Response(status=upstream.status, headers=upstream.headers, body=b'{"kind": "Half an obj')
        if fault.reply is Reply.TRUNCATE:
            out = web.StreamResponse(status=upstream.status, headers=upstream.headers)
            out.content_length = len(upstream.body)
            await out.prepare(request)
            await out.write(upstream.body[: len(upstream.body) // 2])
            return _break_off(request)
        return web.Response(status=upstream.status, headers=upstream.headers, body=upstream.body)

    def _url(self, call: Call) -> URL:
        return URL(self.endpoint.server + call.path, encoded=True)

    async def _headers(self, request: web.BaseRequest) -> dict[str, str]:
        headers = {key: value for key, value in request.headers.items() if key.lower() not in _HOP}
        credentials = self.endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        if credentials.authorization:
            headers["Authorization"] = credentials.authorization
        return headers


@dataclass(frozen=True, slots=True)
class _Answer:
    status: int
    headers: dict[str, str]
    body: bytes


def _refusal(fault: Fault) -> _Answer:
    headers = {"Content-Type": "application/json"}
    if fault.retry_after_s is not None:
        headers["Retry-After"] = f"{fault.retry_after_s:g}"
    status = {
        "kind": "Status",
        "apiVersion": "v1",
        "status": "Failure",
        "code": fault.status,
        "reason": fault.reason,
        "message": fault.message,
    }
    return _Answer(fault.status, headers, json.dumps(status).encode())


def _passed(headers: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in headers.items() if key.lower() not in _HOP}


async def _lines(response: aiohttp.ClientResponse) -> AsyncIterator[bytes]:
    rest = b""
    async for chunk in response.content.iter_any():
        *complete, rest = (rest + chunk).split(b"\n")
        for line in complete:
            yield line + b"\n"


def _break_off(request: web.BaseRequest, *, reset: bool = False) -> web.StreamResponse:
    """Close the client's connection under its request, with a reset if asked for."""
    transport = request.transport
    if transport is not None:
        if reset:
            _linger_zero(transport)
        transport.abort()
    return web.Response(status=500)  # goes nowhere


def _linger_zero(transport: asyncio.Transport) -> None:
    sock = transport.get_extra_info("socket")
    if sock is not None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
