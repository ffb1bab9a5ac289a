"""The fleet view: what runs where, one line per app instance and per bare annotated pod of a namespace.

Derived from claims and pods at any time; nothing is ever read back from it.
"""

from collections.abc import Iterable, Mapping, Sequence
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


def wanted_probes(pairs: Iterable[tuple[str, str]], *, limit: int = 16) -> dict[str, tuple[str, ...]]:
    """Which peers each node's agent should measure, at most `limit`: one direction per pair, where there is room."""
    lists: dict[str, list[str]] = {}
    for one, other in sorted({(min(pair), max(pair)) for pair in pairs if all(pair) and pair[0] != pair[1]}):
        near, far = (one, other) if len(lists.get(one, ())) <= len(lists.get(other, ())) else (other, one)
        if len(lists.get(near, ())) < limit:
            lists.setdefault(near, []).append(far)
        elif len(lists.get(far, ())) < limit:
            lists.setdefault(far, []).append(near)
    return {node: tuple(sorted(peers)) for node, peers in lists.items()}
