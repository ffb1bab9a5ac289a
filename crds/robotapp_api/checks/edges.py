"""Checks of edges: what several edges of one publisher state must agree, or it is unknown what it offers."""

from collections.abc import Iterator, Mapping
from typing import Any

from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.model.app.edge import QOS_DURATIONS, QOS_STRENGTHS, Edge
from robotapp_api.model.names import Annotation
from robotapp_api.values.quantities.bandwidth import bandwidth_bps
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.quantities.quantity import parse_milli


def edge_problems(edges: tuple[Edge, ...]) -> Iterator[Problem]:
    """Contradictions, and rates that are none."""
    yield from _rates(edges)
    yield from _times(edges)
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
    yield from _unmet(edges, {key: known for key, (_, known) in first.items()})


def edge_notes(edges: tuple[Edge, ...]) -> Iterator[Note]:
    """Where a bandwidth is not looked at."""
    if field := bandwidth_field(edges):
        text = f"bandwidth is checked on nodes whose annotation {Annotation.LINK_BANDWIDTH} states what their link carries, and on no others"
        yield Note(field, text)


def bandwidth_field(edges: tuple[Edge, ...]) -> str:
    """The first field that states what an edge takes of the links it crosses; "" where none does."""
    for index, edge in enumerate(edges):
        if _takes_bandwidth(edge):
            return f"spec.edges[{index}].{'bandwidth' if edge.bandwidth is not None else 'rateHz'}"
    return ""


def _takes_bandwidth(edge: Edge) -> bool:
    try:
        return bandwidth_bps(edge.bandwidth, rate_hz=edge.rate_hz, message_bytes=edge.message_bytes) > 0
    except ValueError:
        return False  # its own field is refused for that


def _unmet(edges: tuple[Edge, ...], offered: Mapping[tuple[str, str, str], Mapping[str, Any]]) -> Iterator[Problem]:
    """What an edge asks that its publisher offers at another edge only: the schema compares what stands at one."""
    for index, edge in enumerate(edges):
        if edge.requested_qos is None:
            continue
        own = edge.qos.model_dump(by_alias=True) if edge.qos is not None else {}
        stated = offered[edge.kind, edge.topic, edge.from_]
        for name, asked in edge.requested_qos.model_dump(by_alias=True).items():
            offer = stated.get(f"qos.{name}")
            if own.get(name) is None and _refuses(name, offer, asked):
                yield invalid(
                    f"spec.edges[{index}].requestedQos.{name}",
                    f"{edge.to} asks {edge.topic} with {name} {asked}, but {edge.from_} offers {offer} at another edge of it, so DDS refuses the pair; change one of them",
                )


def _refuses(name: str, offered: str | None, asked: str | None) -> bool:
    """Whether DDS refuses a pair with these two values of one policy. What is absent is not compared."""
    if offered is None or asked is None:
        return False
    if name in QOS_DURATIONS:
        times = [_us(text) for text in (asked, offered)]
        return None not in times and times[0] < times[1]  # type: ignore[operator]  # neither is None
    return (offered, asked) == QOS_STRENGTHS.get(name)


def _times(edges: tuple[Edge, ...]) -> Iterator[Problem]:
    """Durations of 0, which no message keeps. Those of a budget are refused by the schema."""
    for index, edge in enumerate(edges):
        for side, qos in (("qos", edge.qos), ("requestedQos", edge.requested_qos)):
            for name in QOS_DURATIONS if qos is not None else ():
                text = getattr(qos, name)
                if text is not None and _us(text) == 0:
                    cure = f"{text} cannot be kept; write for example 100ms, or leave {name} out for no limit"
                    yield invalid(f"spec.edges[{index}].{side}.{name}", cure)


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
        found = _us(value)
        return value if found is None else found
    return value


def _us(text: str) -> int | None:
    """None for what is no duration that can be; its own field is refused for that."""
    try:
        return parse_us(text)
    except ValueError:
        return None


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
