"""Forwarding a watch line by line, so that faults can strike between events."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from aiohttp import web
from tests.support.proxy.calls import Call
from tests.support.proxy.faults import Fault


@dataclass(eq=False, slots=True)
class OpenWatch:
    """A watch that is being forwarded. `flowing` is cleared to hold its events back, `cut` ends it."""

    call: Call
    flowing: asyncio.Event = field(default_factory=asyncio.Event)
    cut: asyncio.Event = field(default_factory=asyncio.Event)
    passed: int = 0


async def forward(watch: OpenWatch, lines: AsyncIterator[bytes], out: web.StreamResponse, fault: Fault) -> None:
    """Pass lines on until either side ends, the watch is cut or the fault says stop."""
    pump = asyncio.ensure_future(_pump(watch, lines, out, fault))
    cut = asyncio.ensure_future(watch.cut.wait())
    try:
        await asyncio.wait({pump, cut}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (pump, cut):
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await task


async def _pump(watch: OpenWatch, lines: AsyncIterator[bytes], out: web.StreamResponse, fault: Fault) -> None:
    hidden = 0
    if fault.watch and fault.watch != "hide" and fault.after == 0:
        await _strike(b"", out, fault)
        return
    async for line in lines:
        await watch.flowing.wait()
        if fault.watch and watch.passed >= fault.after:
            if fault.watch != "hide":
                await _strike(line, out, fault)
                return
            if hidden < fault.count and (fault.hides is None or fault.hides(line)):
                hidden += 1
                continue
        await out.write(line)
        watch.passed += 1


async def _strike(line: bytes, out: web.StreamResponse, fault: Fault) -> None:
    if fault.watch == "stall":
        await asyncio.Event().wait()
    elif fault.watch == "garble":
        line = line or b'{"type":"ADDED","object":{"metadata":{"name":"cut-off"}}}\n'
        await out.write(line[: len(line) // 2] + b"\n")
    elif fault.watch == "error":
        status = {
            "kind": "Status",
            "apiVersion": "v1",
            "status": "Failure",
            "code": fault.status,
            "reason": fault.reason,
            "message": fault.message,
        }
        await out.write(json.dumps({"type": "ERROR", "object": status}).encode() + b"\n")
