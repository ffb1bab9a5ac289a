"""What holds the event loop is told, and a plugin that does not come back is broken off; real time, a tenth of a second."""

import asyncio
import contextlib
import logging
import os
import re
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from tests.support.scheduler.placing import Scripted, handle_of
from tests.support.scheduling import Clock, make_cluster, make_info, make_node

from robotapp_api.model.names import SCHEDULER_NAME, PodReason
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import BindContext
from robotapp_scheduler.core.framework.plugin_calls import running_call
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.shell.binding.extension_points import ExtensionPoints
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.metrics.timing import PointTimer
from robotapp_scheduler.shell.process.watchdog import Watchdog

LONG_S = 60.0
"""Nothing here may take so long: whatever is not broken off ends by itself then, and fails its test."""


def turn(until_s: float = LONG_S) -> None:
    """Compute for nothing."""
    began_s = time.monotonic()
    while time.monotonic() - began_s < until_s:
        pass


def without_times(text: str) -> str:
    """How long the watchdog waited is the machine's affair: a busy one wakes it late."""
    return re.sub(r"\b\d+(\.\d+)? s\b", "… s", text)


class Loops:
    """Comes back for pods without the label only."""

    name = "Loops"
    reads = ("labels",)

    def filter(self, pod: Any, nodes: Any) -> Any:
        while pod.labels.get("loops"):
            try:
                turn()
                break
            except Exception:  # noqa: BLE001, S112 - as plugins that insist do
                continue
        return np.ones(nodes.n, dtype=np.bool_)

    def reserve(self, _pod: Any, _node: str, _ctx: BindContext) -> None:
        turn()


def core_with(plugin: type) -> SchedulerCore:
    clock = Clock()
    cluster = make_cluster(make_node("n1"), make_node("n2"), clock=clock)
    plugins = {"multiPoint": PluginSet(enabled=(PluginRef(plugin.__name__),))}
    spec = ProfileSpec(SCHEDULER_NAME, plugins=plugins)
    return SchedulerCore(cluster, build_profiles([spec], catalogue({plugin.__name__: plugin})), clock=clock)


@asynccontextmanager
async def watched(**settings: Any) -> AsyncIterator[None]:
    task = asyncio.create_task(Watchdog(patience_s=0.05, again_s=0.05, **settings).run())
    await asyncio.sleep(0)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_a_filter_without_end_is_broken_off_and_its_pod_told_with_the_name_of_the_plugin(
    caplog: pytest.LogCaptureFixture,
) -> None:
    core = core_with(Loops)
    async with watched():
        began_s = time.monotonic()
        decision = core.schedule_one(make_info("bad", labels={"loops": "yes"}))
        assert time.monotonic() - began_s < LONG_S / 2
    assert (decision.placed, decision.reason) == (False, PodReason.SCHEDULER_ERROR)
    assert without_times(decision.message) == "plugin Loops: filter did not answer within … s and was broken off"
    (told,) = [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR]
    assert without_times(told).startswith(
        "filter of plugin Loops has not answered for … s about pod default/bad: it is broken off"
    )
    assert "in turn" in told
    assert core.schedule_one(make_info("good")).placed


async def test_a_filter_that_swallows_whatever_it_is_told_ends_the_process_with_both_names(
    caplog: pytest.LogCaptureFixture,
) -> None:
    ended: list[int] = []

    class Swallows(Loops):
        name = "Swallows"

        def filter(self, _pod: Any, nodes: Any) -> Any:
            while not ended:
                with contextlib.suppress(BaseException):
                    turn(LONG_S / 2)
            return np.ones(nodes.n, dtype=np.bool_)

    core = core_with(Swallows)
    async with watched(end=ended.append):
        began_s = time.monotonic()
        core.schedule_one(make_info("bad"))
        assert time.monotonic() - began_s < LONG_S / 2
    assert ended == [os.EX_SOFTWARE]
    (told,) = [record.getMessage() for record in caplog.records if record.levelno == logging.CRITICAL]
    assert told == (
        "filter of plugin Swallows cannot be broken off about pod default/bad, it catches BaseException: the process ends. "
        "Take the plugin out of the configuration, or delete the pod"
    )


async def test_a_hook_on_the_way_to_the_node_is_broken_off_too() -> None:
    profile = next(iter(core_with(Loops)._runners.values())).profile

    async def promised(*_: Any) -> None:
        raise AssertionError

    async with (
        watched(),
        ExtensionPoints(
            profile, make_info("p"), PointTimer(Metrics()), promised, handle=handle_of(Scripted())
        ) as steps,
    ):
        refused = await steps.run("n1")
    assert refused is not None
    text = 'running Reserve plugin "Loops": Overdue: did not answer within … s and was broken off'
    assert without_times(refused.message) == text


async def test_an_async_hook_that_holds_the_loop_after_an_await_is_broken_off_too() -> None:
    class Awaits(Loops):
        name = "Awaits"

        async def reserve(self, _pod: Any, _node: str, _ctx: BindContext) -> None:
            await asyncio.sleep(0)
            turn()

    profile = next(iter(core_with(Awaits)._runners.values())).profile

    async def promised(*_: Any) -> None:
        raise AssertionError

    handle = handle_of(Scripted())
    async with (
        watched(),
        ExtensionPoints(profile, make_info("p"), PointTimer(Metrics()), promised, handle=handle) as steps,
    ):
        refused = await steps.run("n1")
    assert refused is not None
    text = 'running Reserve plugin "Awaits": Overdue: did not answer within … s and was broken off'
    assert without_times(refused.message) == text
    assert running_call() is None


async def test_a_hint_without_end_counts_as_yes() -> None:
    class Wonders(Loops):
        name = "Wonders"

        def hint(self, _pod: Any, _event: Event) -> bool:
            turn()
            return False

    (hint,) = [
        each.queueing_hint
        for each in core_with(Wonders).runner(SCHEDULER_NAME).profile.filters
        if each.name == "Wonders"
    ]
    pod = make_info("p")
    async with watched():
        began_s = time.monotonic()
        assert hint.wants(pod, Event("pods", Change.POD_REMOVED, pod.pod, None))
    assert time.monotonic() - began_s < LONG_S / 2


def ours(name: str) -> Callable[[float], None]:
    """A function of ours, as the interpreter sees it."""
    module = ModuleType(f"robotapp_scheduler.{name}")
    vars(module).update(vars(sys.modules[__name__]), __name__=module.__name__)
    return type(turn)(turn.__code__, vars(module))


async def test_what_is_ours_is_never_left_half_done() -> None:
    finished: list[float] = []

    class Asks(Loops):
        name = "Asks"

        def filter(self, _pod: Any, nodes: Any) -> Any:
            began_s = time.monotonic()
            ours("looked_up")(0.5)
            finished.append(time.monotonic() - began_s)
            turn()
            return np.ones(nodes.n, dtype=np.bool_)

    core = core_with(Asks)
    async with watched():
        decision = core.schedule_one(make_info("p"))
    assert finished
    assert finished[0] >= 0.5
    assert "did not answer" in decision.message


async def test_what_holds_the_loop_without_a_plugin_is_told_once_and_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    async with watched(deciding=lambda: make_info("p")):
        turn(0.4)
    (told,) = [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR]
    assert without_times(told).startswith(
        "nothing was decided for … s with pod default/p: the event loop is held here\n"
    )
    assert "turn(0.4)" in told


async def test_nothing_is_told_while_the_loop_turns_and_everything_is_as_before_at_the_end(
    caplog: pytest.LogCaptureFixture,
) -> None:
    handler, timer = signal.getsignal(signal.SIGALRM), signal.getitimer(signal.ITIMER_REAL)
    task = asyncio.create_task(Watchdog(patience_s=1.5, again_s=0.1).run())
    await asyncio.sleep(2.2)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert [record for record in caplog.records if record.levelno >= logging.ERROR] == []
    assert signal.getsignal(signal.SIGALRM) is handler
    assert (signal.getitimer(signal.ITIMER_REAL)[0] > 0) == (timer[0] > 0)


async def test_in_another_thread_nothing_is_watched() -> None:
    assert await asyncio.to_thread(asyncio.run, Watchdog().run()) is None
