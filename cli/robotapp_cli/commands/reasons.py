"""Edges of a status with what the scheduler's records know by now."""

from collections.abc import Mapping
from typing import Final

from robotapp_api.values.placement.better_node import TOPIC, edge_to, topic_of
from robotapp_api.values.placement.round_trips import MOVED
from robotapp_cli.commands.apps import MEDIAN
from robotapp_cli.reading.fields import Json, milliseconds, short_ms

_ESTIMATED: Final = "estimated"


def with_what_is_known(edges: list[Json], records: Mapping[str, Json]) -> list[Json]:
    """The edges of a status with what the scheduler knows by now: the age of the newest measurement, that itself where it is
    another one, and an estimate where there is none. `records`: by component.
    """
    return [edge | _known(edge, records) for edge in edges]


def _known(edge: Json, records: Mapping[str, Json]) -> Json:
    now = _now(edge, records)
    source, rtt_ms = now.get("source"), now.get("rttMs")
    if edge.get("measured"):
        if source != "measured" or now.get("ageS") is None:
            return {}
        return {"ageSeconds": now["ageS"], **_newer(edge, now)}
    if edge.get("p95") or source != _ESTIMATED or rtt_ms is None:
        return {}
    return {"p95": f"{rtt_ms:.3f}ms", "estimated": True, "zones": list(now.get("zones") or ())}


def _newer(edge: Json, now: Json) -> Json:
    """The newest measurement, where the figure of the status is about an older one: that follows once a minute at most."""
    shown_ms, newest_ms = milliseconds(edge.get("p95")), now.get("rttMs")
    if now.get("percentile") == MEDIAN:
        return {"newest": f"median {_ms(newest_ms)}"}
    if shown_ms == newest_ms or (shown_ms and newest_ms is not None and abs(newest_ms - shown_ms) < MOVED * shown_ms):
        return {}
    return {"newest": _ms(newest_ms)}


def _ms(value: float | None) -> str:
    return "unreachable" if value is None else f"{short_ms(value)} ms"


def _now(edge: Json, records: Mapping[str, Json]) -> Json:
    """What the scheduler knows of the nodes of an edge; empty when its records name others."""
    topic = topic_of(str(edge.get("kind", TOPIC)), edge["topic"])
    for own, peer in ((edge["from"], edge["to"]), (edge["to"], edge["from"])):
        record = records.get(own) or {}
        for found in record.get("edges") or []:
            here = {record.get("node"), found.get("peerNode")} == set(edge.get("nodes") or [])
            if here and found.get("what") == edge_to(topic, peer):
                now: Json = found.get("now") or found  # a scheduler of the version before has that of the decision only
                return now | {"percentile": found.get("percentile")}
    return {}
