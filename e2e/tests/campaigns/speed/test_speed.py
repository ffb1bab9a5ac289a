"""The verdicts of the speed bench, and the figures they are made from."""

import asyncio
import os
import subprocess
import sys

import pytest
from tests.support.clients import client_for
from tests.support.virtual_time import run_virtually

from campaigns.speed.run import family, usage
from campaigns.speed.verdict import CPU, P99, RATE, judge
from campaigns.speed.watches import PodWatch, SeenPod
from campaigns.speed.workloads import Targets
from robotapp_client import Endpoint
from robotapp_client.api.client import decoder

THEIRS = {RATE: 100.0, CPU: 10.0}
BARE_FIGURES = {RATE: 1000.0, CPU: 0.1, P99: 5.0}


@pytest.mark.parametrize(
    ("rate_found", "missed"),
    [
        (1200.0, False),  # the multiple of kube-scheduler
        (850.0, False),  # not the multiple, but what the bare client leaves
        (849.0, True),
    ],
)
def test_a_rate_is_met_by_the_ratio_or_by_the_share_of_the_bare_client(rate_found: float, missed: bool) -> None:
    verdict = judge(Targets(12), {RATE: rate_found}, THEIRS, BARE_FIGURES)
    assert verdict.met is not missed
    assert verdict.rate_ratio == rate_found / 100
    assert verdict.bare_share == rate_found / 1000


def test_cpu_p99_and_lost_pods_are_judged_on_their_own() -> None:
    ours = {RATE: 1500.0, CPU: 0.5, P99: 16.0, "never bound": 2.0}
    missed = judge(Targets(12, 50, 10), ours, THEIRS, BARE_FIGURES).missed
    assert [text.split()[0] for text in missed] == ["2", "CPU", "p99"]
    assert judge(Targets(12), ours | {"never bound": 0.0}, THEIRS, BARE_FIGURES).met


@pytest.mark.parametrize(("pods", "all_of_them"), [(300, True), (301, False)])
def test_refusing_may_take_as_long_as_it_goes_on(pods: int, all_of_them: bool) -> None:
    """300 pods are refused, one each second."""

    async def refuse() -> bool:
        watch = PodWatch(client_for(Endpoint("http://nobody")), "bench", "")

        async def scheduler() -> None:
            for number in range(300):
                await asyncio.sleep(1)
                watch.refused.add(str(number))
                watch._changed.set()

        async with asyncio.TaskGroup() as group:
            group.create_task(scheduler())
            return await watch.all_refused(pods, stall_s=5)

    assert run_virtually(refuse()) is all_of_them


def test_a_refused_pod_is_one_whose_condition_says_so() -> None:
    refused = b'{"metadata":{},"spec":{},"status":{"conditions":[{"type":"PodScheduled","status":"False"}]}}'
    assert decoder(SeenPod).decode(refused).refused
    assert not decoder(SeenPod).decode(b'{"metadata":{},"spec":{}}').refused


def test_the_usage_of_a_process_counts_its_children() -> None:
    script = "import subprocess,sys;subprocess.run([sys.executable,'-c','input()'])"
    with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE) as child:
        while len(family(child.pid)) < 2:
            assert child.poll() is None
        assert child.pid in family(os.getpid())
        assert usage(child.pid).rss_bytes > usage(family(child.pid)[1]).rss_bytes
        child.communicate(b"\n")
