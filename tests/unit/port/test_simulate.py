"""POST /simulate: streamed to a worker within limits, one at a time."""

import asyncio
import gc
import json
import sys
from collections.abc import AsyncIterator, Mapping
from typing import Any

from tests.support.scheduling import node_json, pod_json

from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.port.pages import kinds, simulation_config
from robotapp_scheduler.port.simulate import Simulator
from robotapp_scheduler.shell.config.reload import Running

SLEEPS = (sys.executable, "-c", "import sys, time; sys.stdin.buffer.read(); time.sleep(60)")
BREAKS = (sys.executable, "-c", "raise SystemExit(3)")
FLOODS = (sys.executable, "-c", "import sys; sys.stdin.buffer.read(); print('x' * (65 << 20))")


def simulator(**settings: Any) -> Simulator:
    async def given() -> Mapping[str, Any]:
        return simulation_config(Running(configuration.built_in(catalogue())))

    return Simulator(given, **settings)


async def chunks(*parts: bytes) -> AsyncIterator[bytes]:
    for part in parts:
        yield part


def error(body: bytes) -> str:
    return str(json.loads(body)["error"])


async def test_a_dump_in_pieces_becomes_placements() -> None:
    items = [{"kind": "Node", **node_json("n")}, {"kind": "Pod", **pod_json("p")}]
    content = json.dumps({"kind": "List", "items": items}).encode()
    subject = simulator()
    status, body = await subject.simulate(chunks(content[:50], content[50:]))
    assert status == 200
    assert json.loads(body)["placements"][0]["node"] == "n"
    status, body = await subject.simulate(chunks(b"kind: Pod"))
    assert status == 400
    assert "no JSON" in error(body)


async def test_a_second_one_is_refused_while_the_first_works() -> None:
    subject = simulator(worker=SLEEPS, timeout_s=1.0)
    first = asyncio.create_task(subject.simulate(chunks(b"{}")))
    await asyncio.sleep(0)
    assert (await subject.simulate(chunks(b"{}")))[0] == 429
    assert (await first)[0] == 504
    assert repr(subject) == "<Simulator idle>"


async def test_too_much_is_refused_while_it_is_sent() -> None:
    status, body = await simulator(worker=SLEEPS, most=1 << 20).simulate(chunks(*[b"x" * (1 << 19)] * 3))
    assert status == 413
    assert "more than 1 MiB" in error(body)


async def test_a_client_that_ends_its_upload_early_holds_nobody_up() -> None:
    async def ends() -> AsyncIterator[bytes]:
        yield b"{"
        raise ConnectionResetError("Connection lost")

    subject = simulator(worker=SLEEPS, timeout_s=60.0)
    status, body = await asyncio.wait_for(subject.simulate(ends()), 10)
    assert (status, error(body)) == (400, "the upload ended early")
    assert repr(subject) == "<Simulator idle>"


async def test_a_worker_that_breaks_or_floods_is_an_error_of_ours() -> None:
    assert (await simulator(worker=BREAKS).simulate(chunks(b"x" * (1 << 20))))[0] == 500
    assert (await simulator(worker=FLOODS).simulate(chunks(b"{}")))[0] == 500


def test_the_kinds_a_dump_is_made_of_can_be_asked_for() -> None:
    assert {
        "group": "",
        "version": "v1",
        "plural": "nodes",
        "kind": "Node",
        "namespaced": False,
    } in kinds()


async def test_a_worker_that_ends_while_it_is_written_to_leaves_no_error_behind() -> None:
    left: list[str] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: left.append(context["message"]))
    status, _ = await simulator(worker=BREAKS).simulate(chunks(*[b"x" * (1 << 20)] * 64))
    assert status == 500
    gc.collect()
    assert left == []


async def test_a_simulation_takes_no_more_memory_than_the_scheduler_leaves() -> None:
    status, body = await simulator(share=lambda: 100 << 20).simulate(chunks(b"{}"))
    assert (status, "has 100 MiB left" in error(body)) == (503, True)
    items = [{"kind": "Pod", **pod_json(f"p{number}")} for number in range(60_000)]
    content = json.dumps({"kind": "List", "items": items}).encode()
    assert len(content) < 64 << 20
    status, body = await simulator(share=lambda: 192 << 20).simulate(chunks(content))
    assert (status, error(body)) == (400, "this takes more than the 192 MiB a simulation may use")
