"""What several edges of one publisher offer and ask, and durations that no message keeps."""

from typing import Any

import pytest

from robotapp_api.checks.edges import edge_problems
from robotapp_api.model.app.edge import Edge


def problems(*edges: dict[str, Any]) -> list[tuple[str, str]]:
    made = tuple(
        Edge.model_validate({"topic": "/scan", "from": "lidar", "to": f"ear-{number}", **edge})
        for number, edge in enumerate(edges)
    )
    return [(found.field, found.message) for found in edge_problems(made)]


@pytest.mark.parametrize(
    ("name", "offered", "asked"),
    [
        ("reliability", "best_effort", "reliable"),
        ("durability", "volatile", "transient_local"),
        ("liveliness", "automatic", "manual_by_topic"),
        ("deadline", "100ms", "20ms"),
        ("lease", "2s", "1500ms"),
    ],
)
def test_what_one_edge_asks_is_compared_with_what_the_publisher_offers_at_another(
    name: str, offered: str, asked: str
) -> None:
    ((field, message),) = problems({"qos": {name: offered}}, {"requestedQos": {name: asked}})
    assert field == f"spec.edges[1].requestedQos.{name}"
    assert message.startswith(f"ear-1 asks /scan with {name} {asked}, but lidar offers {offered} at another edge of it")
    assert problems({"qos": {name: asked}}, {"requestedQos": {name: offered}}) == []
    assert problems({"qos": {name: offered}}, {"requestedQos": {name: asked}, "topic": "/other"}) == []
    assert problems({"requestedQos": {name: asked}}) == [], "what nobody offers is not known"


def test_depth_and_history_are_each_ones_own() -> None:
    offered, asked = {"history": "keep_last", "depth": 1}, {"history": "keep_all", "depth": 9}
    assert problems({"qos": offered}, {"requestedQos": asked}) == []


@pytest.mark.parametrize("side", ["qos", "requestedQos"])
@pytest.mark.parametrize("name", ["deadline", "lease"])
@pytest.mark.parametrize("text", ["0ms", "0s", "0h0m"])
def test_a_duration_of_nothing_is_refused(side: str, name: str, text: str) -> None:
    ((field, message),) = problems({side: {name: text}})
    assert field == f"spec.edges[0].{side}.{name}"
    assert f"leave {name} out" in message
    assert problems({side: {name: "1us"}}) == []
