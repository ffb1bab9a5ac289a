"""Timers around plugins and extension points: sampled, and invisible to what they time."""

from collections.abc import Iterator
from itertools import count
from typing import Any

import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest
from tests.support.scheduling import Clock, default_profiles, make_cluster, make_info, make_node

from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.interface import Code, PreFilter, Status
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.metrics.timing import ONE_IN, Stopwatch, sampled, status_of, time_plugins


def ticking() -> Any:
    """A clock that moves a millisecond each time it is asked."""
    ticks: Iterator[int] = count()
    return lambda: next(ticks) / 1000


def counts(metrics: Metrics, name: str) -> dict[str, float]:
    """Observations per label set."""
    lines = generate_latest(metrics.registry).decode().splitlines()
    start = f"scheduler_{name}_count{{"
    found = [line.removeprefix(start).split("} ") for line in lines if line.startswith(start)]
    return {labels: float(value) for labels, value in found}


def test_one_call_in_ten_is_observed_the_first_one_included_and_answers_pass_through() -> None:
    metrics = Metrics(CollectorRegistry())
    timed = sampled(lambda value: value, metrics.plugin_s, ("Mine", "Filter"), ticking())
    assert [timed(number) for number in range(2 * ONE_IN + 1)] == list(range(2 * ONE_IN + 1))
    assert counts(metrics, "plugin_execution_duration_seconds") == {
        'extension_point="Filter",plugin="Mine",status="Success"': 3.0
    }


def test_a_hook_that_raises_is_observed_as_an_error_and_raises() -> None:
    metrics = Metrics(CollectorRegistry())

    def breaks() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        sampled(breaks, metrics.plugin_s, ("Mine", "Score"), ticking())()
    assert list(counts(metrics, "plugin_execution_duration_seconds")) == [
        'extension_point="Score",plugin="Mine",status="Error"'
    ]


@pytest.mark.parametrize(
    ("answer", "status"),
    [
        (None, "Skip"),
        (True, "Success"),
        (Status(Code.UNSCHEDULABLE, "no"), "Unschedulable"),
        (PreFilter(status=Status(Code.UNRESOLVABLE, "no")), "UnschedulableAndUnresolvable"),
        (PreFilter(names=frozenset()), "Success"),
    ],
)
def test_the_status_is_upstreams_word_for_the_answer(answer: object, status: str) -> None:
    assert status_of(answer) == status


def test_timed_decisions_are_the_same_and_their_points_and_plugins_are_observed() -> None:
    metrics, clock = Metrics(CollectorRegistry()), Clock()
    nodes = [make_node(f"n{number}", cpu=str(number + 1)) for number in range(5)]
    profiles = default_profiles()
    time_plugins(profiles, metrics)
    timed = SchedulerCore(make_cluster(*nodes), profiles, clock=clock, stopwatch=Stopwatch(metrics))
    plain = SchedulerCore(make_cluster(*nodes), default_profiles(), clock=clock)
    for number in range(30):
        pod = make_info(f"p{number}", cpu="9" if number == 0 else "100m")
        again = make_info(f"p{number}", cpu="9" if number == 0 else "100m")
        assert timed.schedule_one(pod).node == plain.schedule_one(again).node
    points = counts(metrics, "framework_extension_point_duration_seconds")
    profile = 'profile="ros-aware-scheduler"'
    assert points[f'extension_point="Filter",{profile},status="Unschedulable"'] == 1
    assert points[f'extension_point="Filter",{profile},status="Success"'] == 2
    assert points[f'extension_point="Score",{profile},status="Success"'] == 3
    plugins = counts(metrics, "plugin_execution_duration_seconds")
    assert any('plugin="NodeResourcesFit"' in labels for labels in plugins)
