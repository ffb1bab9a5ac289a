"""The annotation `robotics.io/better-node` of a pod: where the scheduler would place it now, because a budget is exceeded.

The scheduler alone can plan, so it writes the annotation; the operator alone may evict, so it reads it. A node, the edge for
whose sake it is proposed, as the pod's component sees it, the edge's round-trip time here and there when it was proposed, and until when this holds:
`{"node": "edge-2", "edge": "/odom to driver", "before": "61ms", "after": "8ms", "expires": "2026-01-02T03:04:05Z"}`.
"""

import json
import re
from datetime import datetime
from typing import Any, Final, NamedTuple

from robotapp_api.model.patterns import SUBDOMAIN_PATTERN
from robotapp_api.values.quantities.duration import format_us, parse_us

TOPIC: Final = "Topic"
"""The kind of an edge that is named by its topic alone."""
MAX_BYTES: Final = 1024
MAX_NODE: Final = 253
_NODE: Final = re.compile(SUBDOMAIN_PATTERN)
MOST_USE: Final = 0.9
"""Share of its budget that an edge may use at its new place."""
LEAST_GAIN: Final = 0.2
"""By how much its time must fall."""
_FORM: Final = (
    '{"node": "edge-2", "edge": "/odom to driver", "before": "61ms", "after": "8ms", "expires": "2026-01-02T03:04:05Z"}'
)


class BetterNode(NamedTuple):
    """`edge` as by `edge_to`. `expires` has a time zone."""

    node: str
    edge: str
    before_us: float
    after_us: float
    expires: datetime

    def text(self) -> str:
        """As the annotation's value."""
        value = {
            "node": self.node,
            "edge": self.edge,
            "before": format_us(self.before_us),
            "after": format_us(self.after_us),
            "expires": self.expires.isoformat().replace("+00:00", "Z"),
        }
        return json.dumps(value)


def topic_of(kind: str, topic: str) -> str:
    """For people: the topic, or a service or action by its kind and name."""
    return topic if kind == TOPIC else f"{kind.lower()} {topic}"


def edge_to(topic: str, peer: str) -> str:
    """An edge as one of its ends sees it; `topic` by `topic_of`, `peer` is the other end."""
    return f"{topic} to {peer}"


def is_gain(*, before_us: float, after_us: float, budget_us: float) -> bool:
    """Is it worth a move that an edge needs `after_us` instead of `before_us`?"""
    return after_us <= MOST_USE * budget_us and after_us <= (1 - LEAST_GAIN) * before_us


def parse_better_node(text: str) -> BetterNode:
    """Raises ValueError with a sentence about what is allowed."""
    try:
        value: Any = json.loads(text) if len(text) <= MAX_BYTES else None
        expires = datetime.fromisoformat(value["expires"])
        before_us, after_us = float(parse_us(value["before"])), float(parse_us(value["after"]))
        found = BetterNode(value["node"], value["edge"], before_us, after_us, expires)
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ValueError(f"is not of the form {_FORM}") from None
    if not _is_node(found.node) or not isinstance(found.edge, str) or expires.tzinfo is None:
        raise ValueError(f"is not of the form {_FORM}")
    return found


def _is_node(name: object) -> bool:
    """Could a node have this name? It is shown in a status, and whoever may write pods writes it."""
    return isinstance(name, str) and len(name) <= MAX_NODE and _NODE.fullmatch(name) is not None
