"""Checks of edges: what several edges of one publisher state must agree, or nobody knows what it offers."""

from collections.abc import Iterator
from typing import Any

from robotapp_api.checks.problem import Problem, invalid
from robotapp_api.model.edge import Edge
from robotapp_api.values.duration import parse_us
from robotapp_api.values.quantity import parse_milli


def edge_problems(edges: tuple[Edge, ...]) -> Iterator[Problem]:
    """Contradictions, and rates that are none."""
    yield from _rates(edges)
    first: dict[tuple[str, str, str], tuple[int, dict[str, Any]]] = {}
    for index, edge in enumerate(edges):
        at, known = first.setdefault((edge.kind, edge.topic, edge.from_), (index, {}))
        for field, value in _offered(edge).items():
            before = known.setdefault(field, value)
            if _meaning(field, before) != _meaning(field, value):
                yield invalid(
                    f"spec.edges[{index}].{field}",
                    f"{edge.from_} offers {edge.topic} with {field} {value}, but {before} stands at another edge of it (the first is spec.edges[{at}]); write one value",
                )


def _offered(edge: Edge) -> dict[str, Any]:
    """What the edge states about its publisher's side, by field; what is absent states nothing."""
    found: dict[str, Any] = {"type": edge.type, "messageBytes": edge.message_bytes, "rateHz": edge.rate_hz}
    if edge.qos is not None:
        found |= {f"qos.{name}": value for name, value in edge.qos.model_dump(by_alias=True).items()}
    return {field: value for field, value in found.items() if value is not None}


def _meaning(field: str, value: Any) -> Any:
    """The value itself, whatever words it is written in: 1s is 1000ms, and 500m is 0.5."""
    if field == "rateHz":
        return _milli(value)
    if field in ("qos.deadline", "qos.lease"):
        try:
            return parse_us(value)
        except ValueError:  # no duration that can be; its own field is refused for that
            return value
    return value


def _rates(edges: tuple[Edge, ...]) -> Iterator[Problem]:
    for index, edge in enumerate(edges):
        for field, value in (("rateHz", edge.rate_hz), ("bandwidth", edge.bandwidth)):
            if value is not None and ((milli := _milli(value)) is None or milli < 0):
                yield invalid(f"spec.edges[{index}].{field}", f'{value} cannot be; write for example 20, "0.5" or 40M')


def _milli(quantity: str | int) -> int | None:
    try:
        return parse_milli(quantity)
    except ValueError:
        return None
