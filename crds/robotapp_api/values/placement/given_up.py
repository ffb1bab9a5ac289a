"""The annotation `robotics.io/fallback` of a pod: what its app's fallbacks gave up when the pod was placed.

The scheduler writes it into the Binding; the operator makes `Placed=True` with reason FallbackUsed of it. Preferred budgets that
are exceeded between two nodes, and a later tier of `runsOn`:
`{"edges": [{"edge": "/image", "peer": "detector", "budget": "30ms", "time": "42ms", "source": "measured", "nodes": ["edge-1", "edge-2"]}],
"tier": "Robot", "insteadOf": ["Edge"]}`.
"""

import json
from math import inf
from typing import Any, Final, NamedTuple

from robotapp_api.values.quantities.duration import UNREACHABLE, format_us, parse_us, time_text

MAX_BYTES: Final = 16_384
MAX_EDGES: Final = 8
MAX_TEXT: Final = 512


class GivenUpEdge(NamedTuple):
    """A Preferred budget that is exceeded. `nodes`: the pod's and the other end's; `peer`: a component or `@robot`."""

    edge: str
    peer: str
    budget_us: int
    time_us: float
    """Infinite where no probe was answered."""
    source: str
    """"measured" or "estimated"."""
    nodes: tuple[str, str]


class GivenUp(NamedTuple):
    """`tier` is the one the pod runs on, `instead_of` those that come before it in `runsOn`; empty for the first tier."""

    edges: tuple[GivenUpEdge, ...] = ()
    tier: str = ""
    instead_of: tuple[str, ...] = ()

    def text(self) -> str:
        """As the annotation's value; of many edges those that are exceeded most."""
        worst = sorted(self.edges, key=lambda each: (-each.time_us / max(each.budget_us, 1), each.edge, each.peer))
        value: dict[str, Any] = {"edges": [_edge_json(each) for each in worst[:MAX_EDGES]]} if worst else {}
        if self.tier:
            value |= {"tier": self.tier, "insteadOf": list(self.instead_of)}
        return json.dumps(value)


def parse_given_up(text: str) -> GivenUp:
    """Raises ValueError for what `text` cannot have written: whoever may write pods writes it."""
    try:
        value: Any = json.loads(text) if len(text) <= MAX_BYTES else None
        edges = tuple(_edge_of(each) for each in value.get("edges", ()))
        found = GivenUp(edges, value.get("tier", ""), tuple(value.get("insteadOf", ())))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise ValueError("is not what the scheduler writes") from None
    texts = [found.tier, *found.instead_of, *(part for each in edges for part in (each.edge, each.peer, each.source))]
    texts += [node for each in edges for node in each.nodes]
    if len(edges) > MAX_EDGES or not all(map(_can_be_shown, texts)):
        raise ValueError("is not what the scheduler writes")
    return found


def _can_be_shown(text: object) -> bool:
    """Whether it may stand in a status. Half of a surrogate pair could not be sent at all, and a terminal obeys control characters."""
    return isinstance(text, str) and len(text) <= MAX_TEXT and text.isprintable()


def _edge_json(edge: GivenUpEdge) -> dict[str, Any]:
    return {
        "edge": edge.edge,
        "peer": edge.peer,
        "budget": format_us(edge.budget_us),
        "time": time_text(edge.time_us),
        "source": edge.source,
        "nodes": list(edge.nodes),
    }


def _edge_of(value: Any) -> GivenUpEdge:
    here, there = value["nodes"]
    time_us = inf if value["time"] == UNREACHABLE else float(parse_us(value["time"]))
    return GivenUpEdge(value["edge"], value["peer"], parse_us(value["budget"]), time_us, value["source"], (here, there))
