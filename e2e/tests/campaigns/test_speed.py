"""The speed bench judges others: its verdicts, rates and files must be right themselves."""

import asyncio
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.clients import client_for
from tests.support.virtual_time import run_virtually

from campaigns.scheduler.scheduler import _command, main
from campaigns.speed.console import line, table
from campaigns.speed.contestants import BARE, KUBE_SCHEDULER, OURS
from campaigns.speed.result import Result, Row, merged, read
from campaigns.speed.run import family, pods_for, rate, usage
from campaigns.speed.verdict import CPU, P99, RATE, judge
from campaigns.speed.watches import PodWatch, SeenPod
from campaigns.speed.workloads import ROLE, WORKLOADS, Targets, filler, placed, pod, seed
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


def test_without_anybody_to_compare_with_nothing_is_missed() -> None:
    verdict = judge(Targets(12, 50, 10), {RATE: 1.0, CPU: 1.0, P99: 1.0}, {}, {})
    assert verdict.met
    assert math.isnan(verdict.rate_ratio)


def test_the_first_pod_starts_the_clock() -> None:
    assert rate(11, 2.0) == 5.0
    assert rate(1, 2.0) == rate(5, 0.0) == 0.0


def test_kube_scheduler_gets_fewer_pods_only_where_it_is_slow() -> None:
    slow, basic = WORKLOADS["anti-affinity-waiting"], WORKLOADS["basic"]
    assert pods_for(slow, KUBE_SCHEDULER, pods=None, vs_pods=None) == slow.slow_pods < slow.pods
    assert pods_for(slow, OURS, pods=None, vs_pods=None) == slow.pods
    assert pods_for(basic, KUBE_SCHEDULER, pods=None, vs_pods=None) == basic.pods
    assert pods_for(slow, KUBE_SCHEDULER, pods=100, vs_pods=None) == 100
    assert pods_for(slow, KUBE_SCHEDULER, pods=100, vs_pods=50) == 50


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


def test_each_row_of_a_file_is_read_back_and_a_later_file_replaces_it(tmp_path: Path) -> None:
    results = []
    for number in (1, 2):
        row = Row("basic")
        row.add(OURS.name, 10, {RATE: 100.0 * number, "lost": math.nan})
        result = Result("scripts/bench scheduler", {"nodes": 5}, {"cores": "2"}, [row])
        result.write(tmp_path / f"{number}.json")
        results.append(read(tmp_path / f"{number}.json"))
    (only,) = merged(results)
    assert only.median(OURS.name)[RATE] == 200
    assert merged([results[1], results[0]])[0].median(OURS.name)[RATE] == 100


def test_the_table_has_a_line_for_each_row_and_a_dash_for_what_was_not_measured() -> None:
    row = Row("basic")
    row.add(OURS.name, 10, {RATE: 1234.0})
    made = table([row, Row("churn")])
    assert made.row_count == 2
    assert next(iter(made.columns[1].cells)) == "1,234 / -"
    assert line({"a": math.nan, "b": 0.5}) == "a -, b 0.5"


def test_every_workload_makes_pods_that_say_what_they_are_for() -> None:
    for workload in WORKLOADS.values():
        made = pod("p", "measured", BARE.scheduler_name, workload.pod)
        assert made["metadata"]["labels"][ROLE] == "measured"
        assert "cpu" not in made["spec"]
        assert "labels" not in made["spec"]
        assert made["spec"]["containers"][0]["resources"]["requests"]["cpu"]


def test_scenery_is_bound_from_the_start() -> None:
    assert all(obj["spec"]["nodeName"] for obj in (placed(7, 100), filler(3, 1), seed(11, 100)))
    assert {seed(index, 100)["spec"]["nodeName"][-1] for index in range(30)} == {"0"}  # all in zone-0


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


def test_the_help_says_what_differs_and_lists_every_workload(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    assert "differences" in text
    assert all(name in text for name in WORKLOADS)


def test_the_command_that_is_kept_does_not_name_the_file() -> None:
    assert _command(["--rounds", "1", "--json", "a b.json", "--workload", "x"]) == (
        "scripts/bench scheduler --rounds 1 --workload x"
    )
