"""The scheduler's answer to a replay, as the page shows it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from robotapp_console.views.texts import clean, format_milliseconds

MOST_ROWS: Final = 500


@dataclass(frozen=True, slots=True)
class MovedPod:
    """A pod that would sit elsewhere; `to` is empty where it would sit nowhere."""

    pod: str
    app: str
    present: str
    to: str
    why: str


@dataclass(frozen=True, slots=True)
class ChangedEdge:
    """An edge whose budget would get another verdict."""

    edge: str
    app: str
    budget: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """`judged` of the latest placements were looked at."""

    judged: int
    asked: int
    pods: tuple[MovedPod, ...]
    edges: tuple[ChangedEdge, ...]
    notes: tuple[str, ...]
    hidden_pods: int = 0
    hidden_edges: int = 0
    took_s: float = 0.0


def build_replay(answer: Mapping[str, Any], asked: int) -> ReplayResult:
    """Returns the answer in words. What an older or newer scheduler leaves out is empty."""
    hidden = answer.get("hidden") or {}
    return ReplayResult(
        judged=int(answer.get("replayed") or 0),
        asked=asked,
        pods=tuple(_build_pod(pod) for pod in (answer.get("pods") or [])[:MOST_ROWS]),
        edges=tuple(_build_edge(edge) for edge in (answer.get("edges") or [])[:MOST_ROWS]),
        notes=tuple(clean(str(note)) for note in answer.get("notes") or ()),
        hidden_pods=int(hidden.get("pods") or 0),
        hidden_edges=int(hidden.get("edges") or 0),
        took_s=round(float(answer.get("decidedMs") or 0) / 1000, 2),
    )


def _build_pod(pod: Mapping[str, Any]) -> MovedPod:
    def read(name: str, most: int = 253) -> str:
        return clean(str(pod.get(name) or ""), most)

    app = " ".join(word for word in (read("app"), read("component"), read("instance")) if word)
    return MovedPod(f"{read('namespace')}/{read('pod')}", app, read("from"), read("to"), read("reason", 1000))


def _build_edge(edge: Mapping[str, Any]) -> ChangedEdge:
    def read(name: str) -> str:
        return clean(str(edge.get(name) or ""), 253)

    budget = format_milliseconds(float(edge.get("budgetMs") or 0))
    on_robot = f" on {read('instance')}" if read("instance") else ""
    return ChangedEdge(
        f"{read('from')} → {read('to')} {read('edge')}",
        f"{read('namespace')}/{read('app')}{on_robot}",
        f"{budget} ms p{edge.get('percentile') or 95}",
        _describe_state(edge.get("before")),
        _describe_state(edge.get("after")),
    )


def _describe_state(state: Mapping[str, Any] | None) -> str:
    if not state:
        return "none"
    verdict, milliseconds = clean(str(state.get("verdict") or ""), 32), state.get("rttMs")
    if milliseconds is None:
        return f"{verdict} (no answer)" if verdict == "Exceeded" else verdict
    return f"{verdict} ({format_milliseconds(float(milliseconds))} ms, {clean(str(state.get('source') or ''), 32)})"
