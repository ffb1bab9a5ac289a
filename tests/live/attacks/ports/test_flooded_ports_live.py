"""Strangers and users with small rights at the ports of operator and scheduler, on a real control plane.

`scripts/bench hostile` does the same with thousands of connections while others apply apps.
"""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from urllib.parse import urlsplit

import pytest
from tests.support.work_unit import is_in_time

from campaigns.common.process_use import tree_rss_bytes
from campaigns.hostile.port_flood import MODES, Flood, Target, list_sources
from campaigns.hostile.uploads import CONNECTION_BYTES, Uploader
from campaigns.rigs.ports import ask
from robotapp_operator.health import LIMITS as OPERATOR_LIMITS
from robotapp_scheduler.port.entrance import BUDGET_BYTES
from robotapp_scheduler.port.server_process import LIMITS as SCHEDULER_LIMITS
from robotapp_testbed import ControlPlane, Process, wait_until
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.control_plane.product import start_operator, start_scheduler

pytestmark = pytest.mark.live

CONNECTIONS = 300
MOST_GROWTH = 24 << 20
ACCOUNTS = 8
UPLOADS = 10
ANSWER_S = 5.0
CLOSED_S = 30.0


@contextmanager
def flooded(process: Process, *modes: str, addresses: int = 1) -> Iterator[Flood]:
    """Connections of other addresses than the kubelet's."""
    url = urlsplit(str(process.health_url))
    flood = Flood(Target("127.0.0.1", int(url.port or 0), list_sources(addresses)))
    try:
        for mode in modes:
            flood.open(mode, CONNECTIONS // len(modes))
        yield flood
    finally:
        flood.close()


@pytest.fixture(params=["operator", "scheduler"])
def victim(request: pytest.FixtureRequest, installed_plane: ControlPlane) -> Iterator[tuple[Process, int]]:
    """The process, and how many connections its port takes."""
    name = f"flooded-{request.param}"
    if request.param == "operator":
        process, limits = start_operator(installed_plane, name=name, sweep_seconds=1), OPERATOR_LIMITS
    else:
        process, limits = start_scheduler(installed_plane, name=name, sweep_seconds=1), SCHEDULER_LIMITS
    try:
        yield process, limits.connections
    finally:
        process.stop()


@pytest.mark.parametrize(
    ("modes", "addresses"),
    [(("silent",), 1), (("half-hello",), 1), (tuple(MODES), 1), (("silent",), CONNECTIONS)],
    ids=["silent", "half-hello", "mixed", "crowd"],
)
def test_idle_and_half_open_connections_cost_little_and_probes_are_answered(
    victim: tuple[Process, int], modes: tuple[str, ...], addresses: int
) -> None:
    process, most = victim
    before_bytes = tree_rss_bytes(process.pid)
    with flooded(process, *modes, addresses=addresses) as flood:
        began_s = time.monotonic()
        for path in ("healthz", "readyz"):
            assert ask(f"{process.health_url}/{path}")[0] == 200
        assert is_in_time(time.monotonic() - began_s, ANSWER_S)
        assert tree_rss_bytes(process.pid) - before_bytes < MOST_GROWTH
        assert wait_until(lambda: flood.count_held() <= most, timeout_s=CLOSED_S)
    assert process.running


@pytest.mark.parametrize(
    ("path", "chunked"),
    [("/what-if", False), ("/what-if", True), ("/simulate", False)],
    ids=["promised", "chunked", "of another page"],
)
def test_unfinished_questions_of_many_users_fill_no_memory_and_others_are_answered(
    installed_plane: ControlPlane, namespace: str, path: str, chunked: bool
) -> None:
    """Eight viewers held 390 MB with uploads to /what-if that they never ended. Each has a namespace here, whose accounts share a turn."""
    plane = installed_plane
    scheduler = start_scheduler(plane, name="uploaded", sweep_seconds=1)
    question = b'{"apps": []}'
    try:
        with ExitStack() as stack:
            homes = [stack.enter_context(created(plane, f"{namespace}-{number}")) for number in range(ACCOUNTS)]
            crowd = [stack.enter_context(Uploader(plane, home, "viewer")) for home in homes]
            honest = stack.enter_context(Uploader(plane, namespace, "viewer"))
            page = f"{scheduler.health_url}/what-if?namespace={namespace}"
            ask(page, bearer=honest.token, body=question)
            before_bytes = tree_rss_bytes(scheduler.pid)
            for home, uploader in zip(homes, crowd, strict=True):
                uploader.begin(f"{scheduler.health_url}{path}?namespace={home}", UPLOADS, chunked=chunked)
            grown = tree_rss_bytes(scheduler.pid) - before_bytes
            assert grown < BUDGET_BYTES + SCHEDULER_LIMITS.connections * CONNECTION_BYTES
            status, text = ask(page, bearer=honest.token, body=question)
            assert status == 400, text
            assert "nodeLoss" in text, "the question itself was read"
    finally:
        scheduler.stop()
