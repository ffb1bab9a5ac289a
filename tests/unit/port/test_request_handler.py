"""What the process that places pods answers at once, what a forked worker of it decides once more, and how often."""

import asyncio
import logging
import os
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.support.clients import until
from tests.support.scheduling import Clock, make_core, make_node, make_pod

from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.port.explain import Explainer
from robotapp_scheduler.port.forked_worker import ForkedWorker, WorkerError
from robotapp_scheduler.port.frames import NOT_RECORDED, Request, Response
from robotapp_scheduler.port.remote import Remote
from robotapp_scheduler.port.request_handler import STARTS_AT_ONCE, RequestHandler


class ExplainingScheduler:
    """A scheduler that remembers pod "decided" and knows pod "waiting"."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.core = make_core(make_node("n1"), make_node("n2"))
        self.core.schedule_one(PodInfo(make_pod("decided")))
        self.known = known = [make_pod("decided"), make_pod("waiting")]
        explain = Explainer(self.core, waiting=lambda: known, digest=lambda: "d1", clock=Clock())
        self.made = 0
        self.handler = RequestHandler(
            {"metrics": self._metrics, "broken": self._broken}, explain, self._what_if, clock=self.clock
        )
        self.remote: Remote

    def _what_if(self, request: Request) -> tuple[int, bytes]:
        if request.body == b"die":
            os._exit(3)
        for name in list(self.core.cluster.nodes.row_of):
            self.core.cluster.remove_node(name)
        return 200, b"%d nodes, pid %d" % (self.core.cluster.nodes.count, os.getpid())

    def _metrics(self) -> tuple[int, bytes]:
        self.made += 1
        return 200, b"m"

    def _broken(self) -> tuple[int, bytes]:
        raise RuntimeError("no")


@asynccontextmanager
async def opened() -> AsyncIterator[ExplainingScheduler]:
    world = ExplainingScheduler()
    ours, theirs = socket.socketpair()
    writers = []
    async with asyncio.TaskGroup() as group:
        reader, writer = await asyncio.open_unix_connection(sock=ours)
        writers.append(writer)
        group.create_task(world.handler.serve(reader, writer))
        reader, writer = await asyncio.open_unix_connection(sock=theirs)
        writers.append(writer)
        world.remote = Remote(reader, writer)
        group.create_task(world.remote.run())
        yield world
        for writer in writers:
            writer.close()


def body(response: Response) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.json.decode(response.body)
    return found


async def test_what_is_remembered_is_told_and_what_is_not_takes_another_question() -> None:
    async with opened() as world:
        response = await world.remote.request(Request("explain", namespace="default", pod="decided", with_nodes=True))
        assert (response.status, body(response)["recomputed"]) == (200, False)
        assert (
            await world.remote.request(Request("explain", namespace="default", pod="waiting"))
        ).status == NOT_RECORDED
        assert (await world.remote.request(Request("explain", namespace="default", pod="nobody"))).status == 404


async def test_what_is_decided_again_is_decided_in_a_copy_of_the_process() -> None:
    async with opened() as world:
        before = len(world.core.explain), world.core.decisions()
        response = await world.remote.request(
            Request("decide", namespace="default", pod="waiting", with_nodes=True, full=True)
        )
        assert body(response)["full"]["table"]["nodes"] == ["n1", "n2"]
        assert (len(world.core.explain), world.core.decisions()) == before
        await until(lambda: not children(), what="the idle worker has ended")


async def test_copies_are_few_and_each_answers_many() -> None:
    async with opened() as world:
        for _ in range(20):
            assert (await world.remote.request(Request("decide", namespace="default", pod="waiting"))).status == 200
        for _ in range(STARTS_AT_ONCE - 1):
            await world.handler._end_worker()
            assert (await world.remote.request(Request("decide", namespace="default", pod="waiting"))).status == 200
        await world.handler._end_worker()
        response = await world.remote.request(Request("decide", namespace="default", pod="waiting"))
        assert (response.status, "one at a time" in body(response)["error"]) == (429, True)


async def test_a_pod_that_came_after_the_copy_began_gets_a_new_one() -> None:
    async with opened() as world:
        await world.remote.request(Request("decide", namespace="default", pod="waiting"))
        world.known.append(make_pod("later"))
        assert (await world.remote.request(Request("decide", namespace="default", pod="later"))).status == 200


async def test_the_same_page_for_many_is_made_once_and_a_broken_one_says_so() -> None:
    async with opened() as world:
        response = await asyncio.gather(*(world.remote.page("metrics") for _ in range(50)))
        assert ({each.body for each in response}, world.made) == ({b"m"}, 1)
        assert (await world.remote.page("broken")).status == 500
        await world.remote.request(Request("simulated", status=429))
        assert world.handler.simulations == {"429": 1}


async def test_a_copy_that_takes_too_long_or_dies_is_an_error_and_leaves_nobody() -> None:
    began_s = time.monotonic()
    for work, why, timeout_s in (
        (lambda _: time.sleep(600), "not ready", 0.2),
        (lambda _: os._exit(3), "ended with 3", 60),
        (lambda _: b"" + None, "ended with 1", 60),
    ):
        with pytest.raises(WorkerError, match=why):
            await ForkedWorker(work, timeout_s=timeout_s).request(b"?")  # type: ignore[arg-type]
    assert time.monotonic() - began_s < 300
    assert not children()


async def test_the_loop_turns_while_a_copy_works() -> None:
    turns = 0

    async def turning() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    def slow(encoded: bytes) -> bytes:
        time.sleep(0.3)
        return encoded * 3_000_000

    task = asyncio.create_task(turning())
    worker = ForkedWorker(slow)
    assert await worker.request(b"x") == b"x" * 3_000_000
    await worker.end()
    assert turns > 100
    task.cancel()
    await until(task.done)


def children() -> str:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text()


async def test_what_if_changes_a_copy_that_serves_nothing_else() -> None:
    async with opened() as world:
        response = await world.remote.request(Request("what-if", body=b"{}"))
        assert response.status == 200
        assert response.body.startswith(b"0 nodes, pid ")
        assert world.core.cluster.nodes.count == 2
        assert not children(), "its copy has ended"
        response = await world.remote.request(Request("decide", namespace="default", pod="waiting", full=True))
        assert response.status == 200
        response = await world.remote.request(Request("what-if", body=b"{}"))
        assert (response.status, "try again" in body(response)["error"]) == (429, True)


async def test_what_fails_in_a_copy_is_in_the_log(tmp_path: Path) -> None:
    handler = logging.FileHandler(tmp_path / "log")
    logging.getLogger().addHandler(handler)
    try:
        with pytest.raises(WorkerError, match="ended with 1"):
            await ForkedWorker(lambda _: {}["no such key"]).request(b"?")  # type: ignore[index]
    finally:
        logging.getLogger().removeHandler(handler)
        handler.close()
    assert "KeyError: 'no such key'" in (tmp_path / "log").read_text()


async def test_a_what_if_that_ends_its_copy_is_an_error_and_nothing_more() -> None:
    async with opened() as world:
        response = await world.remote.request(Request("what-if", body=b"die"))
        assert (response.status, "ended with 3" in body(response)["error"]) == (503, True)
        assert world.core.cluster.nodes.count == 2
        assert not children()
