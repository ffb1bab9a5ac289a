"""Our cost per pod beside kube-scheduler's in the same minute: a ratio, because a busy machine slows both alike."""

import asyncio

import pytest

from campaigns.scheduler.scheduler import Bench, Options, plane
from campaigns.speed.contestants import KUBE_SCHEDULER, OURS
from campaigns.speed.result import Row
from campaigns.speed.verdict import CPU

MOST = 0.35
"""Share of kube-scheduler's CPU per pod. It is a tenth or less at this size: the test fails when ours grows to a few times that."""


@pytest.mark.live
@pytest.mark.timeout(1200)
def test_a_pod_with_company_costs_us_a_fraction_of_what_it_costs_kube_scheduler() -> None:
    options = Options(
        workloads=("zone-affinity",),
        contestants=(OURS.name, KUBE_SCHEDULER.name),
        nodes=1000,
        prebound=6000,
        pods=400,
        rounds=1,
        latency_pods=0,
    )
    rows: list[Row] = []
    with plane() as cp:
        asyncio.run(Bench(cp, options).run(rows))
    (row,) = rows
    ours, theirs = row.median(OURS.name), row.median(KUBE_SCHEDULER.name)
    assert "never bound" not in ours
    assert ours[CPU] < MOST * theirs[CPU], f"{ours} against {theirs}"
