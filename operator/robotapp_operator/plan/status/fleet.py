"""The fleet view: what runs where, one line per app instance and per bare annotated pod of a namespace.

Derived from claims and pods at any time; nothing is ever read back from it.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

SHARD_BYTES: Final = 800 * 1024
"""Below the megabyte a ConfigMap may have, with room for metadata."""
MAX_LINE: Final = 1024
MAX_SHARDS: Final = 8
"""The operator may write so many fleet ConfigMaps per namespace: its role names them one by one."""


class Assignment(NamedTuple):
    """An app instance (`robot` "" without robots) or, with `app` "", a bare pod in `parts`."""

    app: str
    robot: str
    domain: int | None
    parts: tuple[tuple[str, str], ...]
    """(component or pod, node or "" while unplaced)."""


def fleet_lines(assignments: Iterable[Assignment]) -> dict[str, str]:
    """ConfigMap keys and values: `app.teleop.amr-07` -> `domain=7 driver@amr-07 operator@edge-1`."""
    lines: dict[str, str] = {}
    for item in assignments:
        key = (
            ".".join(part for part in ("app", item.app, item.robot) if part) if item.app else f"pod.{item.parts[0][0]}"
        )
        domain = [] if item.domain is None else [f"domain={item.domain}"]
        lines[key] = " ".join([*domain, *(f"{part}@{node or '-'}" for part, node in sorted(item.parts))])[:MAX_LINE]
    return lines


def shards(lines: Mapping[str, str], limit: int = SHARD_BYTES) -> Sequence[dict[str, str]]:
    """`lines` in key order, cut into pieces of at most `limit` bytes; none when there are no lines.

    What does not fit into the last piece is left out.
    """
    pieces: list[dict[str, str]] = []
    size = limit
    for key in sorted(lines):
        cost = len(key.encode()) + len(lines[key].encode())
        if size + cost > limit:
            if len(pieces) == MAX_SHARDS:
                break
            pieces.append({})
            size = 0
        pieces[-1][key] = lines[key]
        size += cost
    return pieces


def wanted_probes(
    pairs: Iterable[tuple[str, str]],
    *,
    first: Iterable[tuple[str, str]] = (),
    agents: Container[str] | None = None,
    limit: int = 16,
) -> dict[str, tuple[str, ...]]:
    """Which peers each node's agent should measure, at most `limit`: one direction per pair, where there is room.

    `first`: pairs that get theirs before all others. `agents`: nodes that have one, all unless given; a pair is measured by
    either end, and by none where neither has an agent.
    """
    lists: dict[str, list[str]] = {}
    early = _in_order(first)
    for pair in [*early, *(pair for pair in _in_order(pairs) if pair not in early)]:
        ends = [node for node in pair if agents is None or node in agents]
        for near in sorted(ends, key=lambda node: len(lists.get(node, ()))):  # a tie goes to the first name
            if len(lists.get(near, ())) < limit:
                lists.setdefault(near, []).append(pair[0] if near == pair[1] else pair[1])
                break
    return {node: tuple(sorted(peers)) for node, peers in lists.items()}


def _in_order(pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], None]:
    """Each pair of different nodes once, by name."""
    return dict.fromkeys(sorted({(min(pair), max(pair)) for pair in pairs if all(pair) and pair[0] != pair[1]}))
