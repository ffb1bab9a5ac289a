"""Scheduler, operator and command line read the same reports, and tell the same time of each measured pair."""

from datetime import UTC, datetime
from typing import Any

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduling import Clock, make_cluster, make_node

from robotapp_cli.commands.nodes import reported_round_trips
from robotapp_operator.plan.spec.objects import Telemetry
from robotapp_operator.watch.cache import Cache
from robotapp_scheduler.core.api.robotics_v1alpha1 import NodeTelemetry

NAMES = ("a", "b", "c", "d")
TIMES = st.one_of(st.none(), st.integers(1, 200_000))
ENTRY = st.fixed_dictionaries(
    {"peer": st.sampled_from(NAMES), "p50Us": TIMES, "p95Us": TIMES, "everyRounds": st.sampled_from((None, 1, 3))}
)
REPORT = st.tuples(
    st.sampled_from(NAMES),
    st.fixed_dictionaries(
        {
            "rtt": st.lists(ENTRY, max_size=4, unique_by=lambda entry: entry["peer"]),
            "seq": st.integers(1, 4),
            "intervalSeconds": st.sampled_from((10, 60)),
        }
    ),
    st.sampled_from((0.0, 5.0, 40.0)),
)


@given(st.lists(REPORT, max_size=12))
def test_scheduler_and_operator_tell_the_same_time_of_every_pair(
    reports: list[tuple[str, dict[str, Any], float]],
) -> None:
    clock, cache = Clock(), Cache()
    cluster = make_cluster(*(make_node(name) for name in NAMES), clock=clock)
    for name, status, later_s in reports:
        raw = {"metadata": {"name": name}, "status": status}
        cluster.apply_telemetry(msgspec.convert(raw, NodeTelemetry))
        cache.put_telemetry(msgspec.convert(raw, Telemetry), now_s=clock())
        clock.forward(later_s)
        cluster.tick()
        cache.round_trips.expire(clock())
        for one in NAMES:
            for other in NAMES:
                if one != other:
                    found = cache.round_trips.between(one, other)
                    expected = (None, "unknown") if found is None else (found.p95_us, "measured")
                    assert cluster.rtt.between(one, other, 95) == expected


@given(st.dictionaries(st.sampled_from(NAMES), REPORT.map(lambda report: report[1])))
def test_the_command_line_tells_the_same_of_reports_that_were_just_written(reports: dict[str, dict[str, Any]]) -> None:
    cache, now = Cache(), datetime(2026, 1, 2, tzinfo=UTC)
    written = [{"subresource": "status", "time": now.isoformat()}]
    telemetry = {
        name: {"metadata": {"name": name, "managedFields": written}, "status": status}
        for name, status in reports.items()
    }
    for raw in telemetry.values():
        cache.put_telemetry(msgspec.convert(raw, Telemetry), now_s=0.0)
    shown = reported_round_trips(telemetry, now_s=now.timestamp())
    for name in NAMES:
        assert shown.around(name) == cache.round_trips.around(name)
