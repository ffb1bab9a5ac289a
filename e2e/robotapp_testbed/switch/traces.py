"""A trace: what happens to links over time, read from YAML. Every error names the path of what is wrong.

steps:
- at_s: 0
  links:
  - {between: [robot-1, edge-1], delay_ms: 2, jitter_ms: 0.5}
  - {from: robot-1, to: cloud-1, delay_ms: 30, loss: 0.01, mbit_s: 50}
- at_s: 20
  links: [{node: robot-1, down: true}]
- at_s: 32
  links: [{node: robot-1, down: false}]
repeat_every_s: 60
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import yaml

from robotapp_api.values import strict_yaml
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.switch.links import FIELDS, LinkChange, problem_of

_LONGEST_S = 1e9
_SELECTORS = ("between", "from", "to", "node")


class TraceError(TestbedError):
    """A trace that cannot be read: the text begins with the path, for example `steps[2].links[0].loss`."""

    def __init__(self, path: str, problem: str) -> None:
        super().__init__(f"{path}: {problem}" if path else problem)
        self.path = path


@dataclass(frozen=True, slots=True)
class Step:
    at_s: float
    changes: tuple[LinkChange, ...]


@dataclass(frozen=True, slots=True)
class Trace:
    """Steps in the order of their time. `repeat_every_s` is None for a trace that ends with its last step."""

    steps: tuple[Step, ...]
    repeat_every_s: float | None = None

    @classmethod
    def read(cls, path: Path) -> Self:
        """TraceError when the file is no valid trace; OSError when it cannot be read."""
        return cls.parse(path.read_text())

    @classmethod
    def parse(cls, text: str) -> Self:
        try:
            tree = strict_yaml.loads(text)
        except yaml.YAMLError as error:
            raise TraceError("", f"this is not YAML: {error}") from error
        return cls.from_tree(tree)

    @classmethod
    def from_tree(cls, tree: object) -> Self:
        top = _mapping(tree, "", known=("steps", "repeat_every_s"))
        steps = tuple(_step(each, f"steps[{at}]") for at, each in enumerate(_sequence(top.get("steps"), "steps")))
        for at, (before, after) in enumerate(pairwise(steps), start=1):
            if after.at_s < before.at_s:
                raise TraceError(f"steps[{at}].at_s", f"{after.at_s:g} is before the step above it ({before.at_s:g})")
        if "repeat_every_s" not in top:
            return cls(steps=steps)
        every_s = _number(top["repeat_every_s"], "repeat_every_s")
        if every_s <= steps[-1].at_s:
            raise TraceError("repeat_every_s", f"{every_s:g} is not after the last step ({steps[-1].at_s:g})")
        return cls(steps=steps, repeat_every_s=every_s)

    def nodes(self) -> set[str]:
        return {node for step in self.steps for change in step.changes for node in change.nodes()}

    def step(self, number: int) -> Step | None:
        """The `number`-th step from 0, repetitions counted, with its time since the beginning; None after the end."""
        rounds, at = divmod(number, len(self.steps))
        if rounds and self.repeat_every_s is None:
            return None
        step = self.steps[at]
        return Step(at_s=step.at_s + rounds * (self.repeat_every_s or 0.0), changes=step.changes)


def _step(tree: object, path: str) -> Step:
    fields = _mapping(tree, path, known=("at_s", "links"))
    if "at_s" not in fields:
        raise TraceError(f"{path}.at_s", "when the step happens is missing")
    at_s = _number(fields["at_s"], f"{path}.at_s")
    links = _sequence(fields.get("links"), f"{path}.links")
    return Step(at_s=at_s, changes=tuple(_change(each, f"{path}.links[{at}]") for at, each in enumerate(links)))


def _change(tree: object, path: str) -> LinkChange:
    fields = _mapping(tree, path, known=(*_SELECTORS, *FIELDS))
    values = {name: value for name, value in fields.items() if name in FIELDS}
    for name, value in values.items():
        problem = problem_of(name, value)
        if problem:
            raise TraceError(f"{path}.{name}", problem)
    if not values:
        raise TraceError(path, f"nothing is set, say one of {', '.join(FIELDS)}")
    given = sorted(name for name in _SELECTORS if name in fields)
    if given == ["node"]:
        return LinkChange(values, node=_name(fields["node"], f"{path}.node"))
    if given == ["between"]:
        pair = _sequence(fields["between"], f"{path}.between")
        if len(pair) != 2:
            raise TraceError(f"{path}.between", f"a link is between two nodes, here are {len(pair)}")
        origin, target = (_name(each, f"{path}.between[{at}]") for at, each in enumerate(pair))
    elif given == ["from", "to"]:
        origin, target = (_name(fields[each], f"{path}.{each}") for each in given)
    else:
        raise TraceError(path, "say which links: either `between: [a, b]`, or `from:` and `to:`, or `node:`")
    if origin == target:
        raise TraceError(path, f"a link is between two nodes, not from {origin} to itself")
    return LinkChange(values, origin=origin, target=target, one_way="from" in given)


def _mapping(tree: object, path: str, *, known: Sequence[str]) -> Mapping[str, Any]:
    if not isinstance(tree, dict):
        raise TraceError(path, f"a mapping with {', '.join(known)} is expected, not {_kind(tree)}")
    for name in tree:
        if name not in known:
            where = f"{path}.{name}" if path else str(name)
            raise TraceError(where, f"there is no such field, known are {', '.join(known)}")
    return tree


def _sequence(tree: object, path: str) -> list[object]:
    if not isinstance(tree, list) or not tree:
        raise TraceError(path, f"a list with at least one entry is expected, not {_kind(tree)}")
    return tree


def _number(tree: object, path: str) -> float:
    if isinstance(tree, bool) or not isinstance(tree, int | float) or not 0 <= tree <= _LONGEST_S:
        raise TraceError(path, f"{tree!r:.40} is not a number of seconds from 0 to {_LONGEST_S:g}")
    return float(tree)


def _name(tree: object, path: str) -> str:
    if not isinstance(tree, str) or not tree:
        raise TraceError(path, f"{tree!r} is not the name of a node")
    return tree


def _kind(tree: object) -> str:
    return "nothing" if tree in (None, [], {}) else type(tree).__name__
