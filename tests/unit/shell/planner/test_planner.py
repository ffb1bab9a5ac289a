"""The planning worker: asked, killed, silent, talking nonsense; the answer always comes, and says what happened."""

import asyncio
import os
import signal
import sys
from random import Random
from typing import Any

import pytest
from tests.support.clients import until
from tests.support.scheduler.joint_problems import field_problem

from robotapp_scheduler.core.cycle.joint_problem import JointProblem
from robotapp_scheduler.joint.problem import Problem
from robotapp_scheduler.shell.planner.container_memory import PLANNER_BYTES
from robotapp_scheduler.shell.planner.planner import LEAST_MEMORY, PAUSE_S, Planner

READY = "import sys, time; out = sys.stdout.buffer; out.write(bytes(4)); out.flush();"
SILENT = (sys.executable, "-c", f"{READY} time.sleep(60)")
DIES = (sys.executable, "-c", f"{READY} sys.stdin.buffer.read(4)")
NONSENSE = (
    sys.executable,
    "-c",
    f"{READY} sys.stdin.buffer.read(4); out.write(b'\\0\\0\\0\\2no'); out.flush(); time.sleep(60)",
)
FLOODS = (
    sys.executable,
    "-c",
    f"{READY} sys.stdin.buffer.read(4); out.write(b'\\xff' * 4); out.flush(); time.sleep(60)",
)
NEVER_STARTS = (sys.executable, "-c", "import time; time.sleep(60)")
MISSING = ("/nonexistent/worker",)


class Seconds:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def joint(pods: int = 6, *, seed: int = 3) -> JointProblem:
    problem = field_problem(Random(seed), pods=pods, edges=pods, rows=60)
    return JointProblem(problem, tuple(f"u{i}" for i in range(pods)), tuple(f"n{i}" for i in range(60)))


def planner(**settings: Any) -> Planner:
    return Planner(**{"small": 0, "start_s": 20.0, "answer_timeout_s": 20.0, **settings})


async def test_a_worker_plans_and_is_kept_for_the_next_one() -> None:
    subject = planner()
    try:
        first, second = await asyncio.gather(subject.advise(joint()), subject.advise(joint()))
        assert first.result in {"optimal", "bounded"}
        assert set(first.nodes) == {f"u{i}" for i in range(6)}
        assert first.nodes == second.nodes
        assert subject.starts == 1
        assert repr(subject).startswith("<Planner worker ")
    finally:
        await subject.close()
    assert repr(subject) == "<Planner no worker, 1 starts>"


async def test_a_small_problem_needs_no_worker() -> None:
    subject = planner(small=1 << 30)
    assert (await subject.advise(joint(3, seed=0))).nodes
    assert subject.starts == 0


async def test_a_killed_worker_is_started_again_after_a_pause() -> None:
    clock = Seconds()
    subject = planner(clock=clock)
    try:
        assert (await subject.advise(joint())).nodes
        assert subject._process is not None
        os.kill(subject._process.pid, signal.SIGKILL)
        clock.now_s += PAUSE_S
        found = [await subject.advise(joint()) for _ in range(2)]
        # The death may be seen before the next problem is sent, or by its missing answer.
        assert found[0].nodes or found[0].result == "failed"
        clock.now_s += PAUSE_S
        assert (await subject.advise(joint())).nodes
        assert subject.starts == 2
    finally:
        await subject.close()


async def test_whatever_a_worker_does_wrong_the_pods_are_placed_one_by_one_and_it_is_said() -> None:
    for worker, text in (
        (SILENT, "no answer in time"),
        (DIES, "it died"),
        (NONSENSE, ""),
        (FLOODS, "an answer of 4294967295 bytes"),
        (NEVER_STARTS, "no answer in time"),
        (MISSING, "FileNotFoundError"),
    ):
        hurried = {"answer_timeout_s": 0.2} if worker is SILENT else {"start_s": 0.5} if worker is NEVER_STARTS else {}
        subject = planner(worker=worker, **hurried)
        found = await subject.advise(joint())
        assert (found.result, dict(found.nodes)) == ("failed", {}), worker
        assert text in found.why
        assert found.why.startswith("the planning worker failed")
        again = await subject.advise(joint())
        assert "it died a moment ago" in again.why
        assert repr(subject) == "<Planner no worker, 1 starts>"


async def test_a_worker_without_memory_is_not_started_and_the_cure_is_said() -> None:
    subject = planner(share=lambda: 20 << 20)
    for _ in range(2):
        placement = await subject.advise(joint())
        assert (placement.result, dict(placement.nodes)) == ("failed", {})
        assert "the container has 20 MiB left: raise scheduler.resources.limits.memory" in placement.why
    assert subject.starts == 0


def make_largest() -> JointProblem:
    """As many pods, nodes and edges as there may be, each edge with prices of its own."""
    problem = field_problem(Random(1), pods=96, edges=256, rows=5000)
    edges = tuple(edge._replace(budget_us=edge.budget_us + index) for index, edge in enumerate(problem.edges))
    problem = Problem(problem.cost, problem.demand, problem.free, edges, problem.rtt)
    return JointProblem(problem, tuple(map(str, range(96))), tuple(map(str, range(5000))))


@pytest.mark.parametrize(
    ("share", "result"), [(PLANNER_BYTES, "bounded"), (LEAST_MEMORY, "failed")], ids=["in-its-share", "in-less"]
)
async def test_the_largest_problem_is_solved_in_the_share_of_the_worker(share: int, result: str) -> None:
    """With less the worker ends, and the pods are placed one by one."""
    subject = planner(share=lambda: share, answer_timeout_s=60.0)
    try:
        assert (await subject.advise(joint())).nodes
        assert (await subject.advise(make_largest())).result == result
    finally:
        await subject.close()


async def test_who_waits_too_long_for_its_turn_goes_without() -> None:
    subject = planner(worker=SILENT, answer_timeout_s=1.0, turn_s=0.05)
    first = asyncio.create_task(subject.advise(joint()))
    await asyncio.sleep(0)
    assert (await subject.advise(joint())).result == "busy"
    assert (await first).result == "failed"


async def test_a_caller_that_is_cancelled_takes_the_worker_with_it() -> None:
    subject = planner(worker=SILENT)
    asked = asyncio.create_task(subject.advise(joint()))
    await until(lambda: subject._process is not None, what="the worker is started")
    asked.cancel()
    await asyncio.wait([asked])
    assert asked.cancelled()
    assert subject._process is None
