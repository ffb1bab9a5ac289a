"""How explain says that the time of an edge is known: measured and how old, estimated from which zones, or not at all."""

from typing import Any

import pytest
from tests.unit.cli.running import INSTANCES, ROBOTAPPS, Stage, instance, pod, robotapp

EDGE = {"topic": "/cmd_vel", "from": "panel", "to": "driver", "latency": {"budget": "30ms"}}
OBSERVED = {"topic": "/cmd_vel", "from": "panel", "to": "driver", "budget": "30ms", "nodes": ["edge-1", "amr-07"]}
MEASURED = {**OBSERVED, "measured": True, "p95": "18ms"}


def shown(stage: Stage, observed: dict[str, Any], *, percentile: int = 95, **now: Any) -> str:
    """The line of the edge; `now` is what the scheduler knows of its nodes."""
    stage.add(ROBOTAPPS, robotapp(edges=[{**EDGE, "latency": {"budget": "30ms", "percentile": percentile}}]))
    stage.add(INSTANCES, instance(edges=[observed]))
    stage.add("/pods", pod("panel-1", "panel", node="edge-1"))
    known = {"rttMs": None, "source": "unknown", "ageS": None, "zones": [], **now}
    edge = {"what": "/cmd_vel to driver", "peerNode": "amr-07", "rttMs": 2.0, "source": "measured", "now": known}
    edge["percentile"] = percentile
    stage.scheduler.records = {"panel-1": {"node": "edge-1", "edges": [edge]}}
    text = stage.text("explain", "teleop", "--scheduler-url", stage.scheduler.url)
    return next(line.rstrip() for line in text.splitlines() if "/cmd_vel" in line)


@pytest.mark.parametrize(("age_s", "text"), [(0.2, "0s"), (4.7, "4s"), (130.0, "2m")])
def test_a_measured_edge_has_the_figure_of_the_status_and_the_age_of_the_measurement(
    stage: Stage, age_s: float, text: str
) -> None:
    line = shown(stage, MEASURED, rttMs=17.0, source="measured", ageS=age_s)
    assert line.endswith(f"measured {text} ago")
    assert "18/30 ms" in line


def test_an_unreachable_edge_says_so_with_its_age(stage: Stage) -> None:
    line = shown(stage, {**OBSERVED, "measured": True}, source="measured", ageS=130.0)
    assert "unreachable/30 ms" in line
    assert line.endswith("measured 2m ago")


def test_a_measurement_the_scheduler_does_not_know_has_no_age(stage: Stage) -> None:
    assert shown(stage, MEASURED).endswith("measured")


def test_an_estimate_is_the_one_of_now_and_names_the_zones(stage: Stage) -> None:
    line = shown(stage, OBSERVED, rttMs=21.5, source="estimated", zones=["floor", "hall"])
    assert "21.5/30 ms" in line
    assert line.endswith("estimated (floor, hall)")
    assert shown(stage, OBSERVED, rttMs=1.0, source="estimated", zones=["hall", "hall"]).endswith("estimated (hall)")


def test_what_nobody_knows_is_unknown(stage: Stage) -> None:
    line = shown(stage, OBSERVED)
    assert "?/30 ms" in line
    assert line.endswith("unknown")


@pytest.mark.parametrize(("newest_ms", "text"), [(80.0, "80 ms"), (None, "unreachable"), (14.0, "14 ms")])
def test_a_newer_measurement_that_the_status_does_not_have_yet_is_told_with_its_own_age(
    stage: Stage, newest_ms: float | None, text: str
) -> None:
    """Before, the figure of a minute ago was said to be measured two seconds ago."""
    line = shown(stage, MEASURED, rttMs=newest_ms, source="measured", ageS=2.0)
    assert "18/30 ms" in line
    assert line.endswith(f"measured, {text} 2s ago")


def test_a_budget_of_the_median_is_not_compared_with_the_95th_percentile(stage: Stage) -> None:
    slow = {**MEASURED, "p95": "45ms", "met": True}
    line = shown(stage, slow, percentile=50, rttMs=18.0, source="measured", ageS=2.0)
    assert "30 ms for the median, p95 45 ms   met " in line
    assert line.endswith("measured, median 18 ms 2s ago")
