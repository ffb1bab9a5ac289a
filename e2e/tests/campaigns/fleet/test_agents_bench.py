"""What `scripts/bench agents` and `scripts/bench agent` count, and when they complain."""

import argparse
from typing import Any

import pytest

from campaigns.fleet import agents_schedule
from campaigns.fleet.agents import verdict


def rows(**changes: Any) -> list[dict[str, Any]]:
    start = {"phase": "start", "busiest_second": changes.get("busiest_second", 60), "writes_per_s": 45.0}
    start |= {"stalled_s": changes.get("stalled_s", 0.1), "p99_ms": changes.get("p99_ms", 90.0)}
    return [start, {"phase": "steady", "busiest_second": 60, "writes_per_s": changes.get("writes_per_s", 47.0)}]


OPTIONS = argparse.Namespace(agents=5000, limit=50.0)


def test_too_many_writes_a_herd_at_the_start_and_missing_objects_are_told() -> None:
    assert "51.0 writes/s in steady state" in verdict(rows(writes_per_s=51.0), 5000, OPTIONS)[0]
    assert "101 writes in one second of the start" in verdict(rows(busiest_second=101), 5000, OPTIONS)[0]
    assert "4999 of 5000" in verdict(rows(), 4999, OPTIONS)[0]


@pytest.mark.parametrize("stall", [{"stalled_s": 0.9}, {"p99_ms": 2000.0}])
def test_a_herd_that_a_stall_of_the_machine_made_is_not_held_against_the_agents(stall: dict[str, float]) -> None:
    assert verdict(rows(busiest_second=160, **stall), 5000, OPTIONS) == []


def test_agents_that_start_together_write_no_more_than_chance_makes_in_any_second() -> None:
    options = argparse.Namespace(agents=800, seconds=10, noise=0.1, seed=1)
    found = agents_schedule.measured(options)
    assert max(found["busiest_second"], found["busiest_second_of_start"]) < agents_schedule.HERD * OPTIONS.limit
