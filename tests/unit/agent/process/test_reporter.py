"""The reporter in virtual time: what it writes, and when, while the API server works, is away, or refuses."""

import asyncio
import itertools
import logging
from collections.abc import Callable

import pytest
from tests.support.agent.agents import cpu, readings, trip
from tests.support.virtual_time import run_virtually

from robotapp_agent.report.changes import Pace
from robotapp_agent.report.readings import Load, Readings
from robotapp_agent.report.status import LoadStatus, Status
from robotapp_agent.shell.reporter import Reporter, explain, is_refusal
from robotapp_client.transport.errors import (
    ClientError,
    Conflict,
    Forbidden,
    Invalid,
    NotFound,
    ServerError,
    TooManyRequests,
    Unauthorized,
    Unreachable,
)

HOUR_S = 3600.0
AWAY = Unreachable("connection refused", maybe_applied=False)


class Server:
    """Takes every status, unless `trouble` is set."""

    def __init__(self) -> None:
        self.trouble: ClientError | None = None
        self.tried: list[float] = []
        self.written: list[tuple[float, Status]] = []
        self.refused = ""
        self.probe: tuple[str, ...] = ()

    async def write(self, status: Status) -> tuple[str, ...]:
        now_s = asyncio.get_running_loop().time()
        self.tried.append(now_s)
        if self.trouble is not None:
            raise self.trouble
        self.written.append((now_s, status))
        return self.probe


class Node:
    """An agent's reporter with readings that the test changes."""

    def __init__(self, server: Server) -> None:
        self.server = server
        self.readings = readings()
        self.asked: list[tuple[str, ...]] = []
        clock = asyncio.get_running_loop().time
        self.reporter = Reporter(
            server,
            lambda: self.readings,
            pace=Pace(first_s=clock(), uniform=lambda: 0.5),
            asked=self.asked.append,
            clock=clock,
            uniform=lambda: 0.0,
        )

    def becomes(self, found: Readings) -> None:
        self.readings = found
        self.reporter.wake()


def living(story: Callable[[Node], object]) -> Server:
    """Run a story (a coroutine function) beside the reporter; returns the server it wrote to."""
    server = Server()

    async def life() -> None:
        node = Node(server)
        task = asyncio.create_task(node.reporter.run())
        await story(node)  # type: ignore[misc]
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    run_virtually(life())
    return server


def load_of(status: Status) -> LoadStatus:
    assert status.load is not None
    return status.load


def test_at_rest_only_heartbeats_are_written() -> None:
    async def story(_: Node) -> None:
        await asyncio.sleep(100)

    server = living(story)
    assert [round(at_s, 1) for at_s, _ in server.written] == [pytest.approx(11.5 * each) for each in range(9)]


def test_a_change_is_written_two_seconds_after_the_last_write() -> None:
    async def story(node: Node) -> None:
        await asyncio.sleep(0.5)
        node.becomes(readings(round_trips=(trip(p50_us=None),)))
        await asyncio.sleep(5)

    server = living(story)
    assert [at_s for at_s, _ in server.written] == [0.0, 2.0]


def test_a_change_that_passes_within_two_seconds_is_never_written() -> None:
    async def story(node: Node) -> None:
        await asyncio.sleep(0.5)
        node.becomes(readings(devices=()))
        await asyncio.sleep(0.5)
        node.becomes(readings())
        await asyncio.sleep(5)

    assert len(living(story).written) == 1


def test_after_an_hour_without_api_server_the_newest_state_is_written_once() -> None:
    async def story(node: Node) -> None:
        await asyncio.sleep(1)
        node.server.trouble = AWAY
        for minute in range(60):
            node.becomes(readings(load=cpu(minute), seq=7 + minute))
            await asyncio.sleep(60)
        node.server.trouble = None
        await asyncio.sleep(30)

    server = living(story)
    away = [at_s for at_s in server.tried if 1 < at_s <= HOUR_S + 1]
    assert len(away) < HOUR_S / 15
    assert all(later - sooner <= 30.1 for sooner, later in itertools.pairwise(away))
    back = [(at_s, status) for at_s, status in server.written if at_s > HOUR_S]
    at_s, status = back[0]
    assert at_s <= HOUR_S + 1 + 30.1
    assert load_of(status).cpu_percent == 59
    assert all(later - sooner >= 10 for (sooner, _), (later, _) in itertools.pairwise(back))


def test_a_refusal_is_tried_again_rarely_and_the_log_tells_what_to_do_once(caplog: pytest.LogCaptureFixture) -> None:
    async def story(node: Node) -> None:
        node.server.trouble = Forbidden("nodetelemetries.robotics.io is forbidden", status=403)
        await asyncio.sleep(HOUR_S)

    with caplog.at_level(logging.WARNING):
        server = living(story)
    assert 12 <= len(server.tried) <= 16
    assert 5 <= len(caplog.messages) <= 7
    assert "install the chart's RBAC and policies" in caplog.messages[0]


def test_the_servers_wish_for_a_pause_is_honoured_up_to_five_minutes() -> None:
    async def story(node: Node) -> None:
        node.server.trouble = TooManyRequests("slow down", status=429, retry_after_s=45)
        await asyncio.sleep(100)
        node.server.trouble = TooManyRequests("never", status=429, retry_after_s=1e9)
        await asyncio.sleep(700)

    server = living(story)
    assert server.tried[:3] == [0.0, 45.0, 90.0]
    assert server.tried[3:] == [135.0, 435.0, 735.0]


def test_the_end_of_the_trouble_is_logged_and_a_later_one_begins_with_short_pauses(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def story(node: Node) -> None:
        for _ in range(2):
            node.server.trouble = AWAY
            await asyncio.sleep(100)
            node.server.trouble = None
            await asyncio.sleep(100)

    with caplog.at_level(logging.INFO):
        server = living(story)
    assert sum("written again" in message for message in caplog.messages) == 2
    gaps = [later - sooner for sooner, later in zip(server.tried, server.tried[1:], strict=False)]
    assert gaps[0] == 4.0
    assert gaps.count(4.0) == 2


def test_what_the_operator_wants_measured_comes_with_each_write() -> None:
    async def story(node: Node) -> None:
        node.server.probe = ("edge-2",)
        await asyncio.sleep(12)
        assert node.asked == [("edge-2",), ("edge-2",)]

    living(story)


def test_a_part_that_was_left_out_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    async def story(node: Node) -> None:
        node.server.refused = "status.devices[0].id: Invalid value"
        await asyncio.sleep(100)

    with caplog.at_level(logging.ERROR):
        living(story)
    assert len(caplog.messages) == 1
    assert "status.devices[0].id" in caplog.messages[0]


def test_an_unknown_load_stays_unknown_without_a_word() -> None:
    async def story(node: Node) -> None:
        node.becomes(readings(load=Load()))
        await asyncio.sleep(5)

    assert living(story).written[0][1].load is None


@pytest.mark.parametrize(
    ("error", "refusal"),
    [
        (AWAY, False),
        (ServerError("etcd", status=503), False),
        (Conflict("again", status=409), False),
        (TooManyRequests("later", status=429), False),
        (Unauthorized("token", status=401), False),
        (Forbidden("policy", status=403), True),
        (NotFound("no such kind", status=404), True),
        (Invalid("status", status=422), True),
    ],
)
def test_only_what_an_administrator_can_change_is_a_refusal(error: ClientError, refusal: bool) -> None:
    assert is_refusal(error) == refusal
    assert explain(error).startswith(str(error))
