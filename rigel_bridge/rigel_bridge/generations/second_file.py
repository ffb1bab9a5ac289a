"""A second file that completes a Rigelfile: Rigel 0.3 refuses a file that has `orchestration` at its top."""

from dataclasses import replace
from typing import Final

from rigel_bridge.document.failures import nearest
from rigel_bridge.document.tree import Node

KEYS: Final = ("application", "orchestration", "sequences", "vars")


def completed_by(root: Node, other: Node) -> Node:
    """The Rigelfile with the keys of the other file added. A key that both have is an error, except `vars`, which are joined."""
    top = dict(root.mapping())
    for key, node in other.mapping().items():
        if key not in KEYS:
            raise node.fail(f"is not known beside a Rigelfile{nearest(key, [*KEYS])}; known: {', '.join(KEYS)}")
        if key == "vars" and key in top:
            top[key] = _joined(top[key], node)
        elif key in top:
            raise node.fail(f"is already in {top[key].place}: keep one")
        else:
            top[key] = node
    return replace(root, value=top)


def _joined(first: Node, second: Node) -> Node:
    values = dict(first.mapping())
    for name, node in second.mapping().items():
        if name in values:
            raise node.fail(f"is already in {values[name].place}: keep one")
        values[name] = node
    return replace(first, value=values)
