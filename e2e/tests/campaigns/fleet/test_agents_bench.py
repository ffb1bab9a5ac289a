"""What `scripts/bench agents` and `scripts/bench agent` count, and when they complain."""

import argparse
from typing import Any

import pytest

from campaigns.fleet import agents_schedule
from campaigns.fleet.agents import Ledger, SimulatedNode, verdict


def rows(**changes: Any) -> list[dict[str, Any]]:
    start = {"phase": "start", "busiest_second": changes.get("busiest_second", 60), "writes_per_s": 45.0}
    start |= {"stalled_s": changes.get("stalled_s", 0.1), "p99_ms": changes.get("p99_ms", 90.0)}
    return [start, {"phase": "steady", "busiest_second": 60, "writes_per_s": changes.get("writes_per_s", 47.0)}]


OPTIONS = argparse.Namespace(agents=5000, limit=50.0)


def test_the_ledger_counts_writes_of_a_time_and_its_busiest_second() -> None:
    ledger = Ledger(sent_s=[1.0, 1.2, 1.9, 2.1, 5.0])
    assert len(ledger.between(1.0, 5.0)) == 4
    assert ledger.busiest_second(1.0, 6.0) == 3
    assert ledger.busiest_second(7.0, 8.0) == 0


def test_a_run_within_the_limits_is_as_intended() -> None:
    assert verdict(rows(), 5000, OPTIONS) == []


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


def test_a_simulated_node_gives_what_files_and_sockets_would() -> None:
    node = SimulatedNode(1, noise=0.1, nodes=100)
    before, after = node.sample(), node.sample()
    assert before.cpu is not None
    assert after.cpu is not None
    assert after.cpu.total > before.cpu.total
    results = node.round()
    assert 1 <= len(results) <= 16
    assert all(result.p50_us is not None and result.p95_us is not None for result in results)
    assert all((result.p50_us or 0) <= (result.p95_us or 0) for result in results)
