"""What can be set on a link between two nodes, as data. Names and units are those of the switch's control protocol."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

LIMITS: Final = {"delay_ms": 60_000.0, "jitter_ms": 60_000.0, "loss": 1.0, "mbit_s": 1e6, "buffer_ms": 60_000.0}
"""Greatest value of each number; the least is 0."""

FIELDS: Final = (*LIMITS, "down")


@dataclass(frozen=True, slots=True)
class Link:
    """One direction. `jitter_ms` comes on top of the delay, uniform in 0…jitter, order is kept; `loss` is a share of
    the frames; `mbit_s` 0 is unlimited; what would wait longer than `buffer_ms` for bandwidth is dropped."""

    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    loss: float = 0.0
    mbit_s: float = 0.0
    buffer_ms: float = 200.0
    down: bool = False


@dataclass(frozen=True, slots=True)
class LinkChange:
    """New values for some fields of some links: from one node to another (and back unless `one_way`), or all of `node`."""

    values: Mapping[str, float | bool]
    origin: str = ""
    target: str = ""
    one_way: bool = False
    node: str = ""

    def __post_init__(self) -> None:
        for name, value in self.values.items():
            problem = problem_of(name, value)
            if problem:
                raise ValueError(f"{name}: {problem}")

    def nodes(self) -> tuple[str, ...]:
        return (self.node,) if self.node else (self.origin, self.target)

    def as_json(self) -> dict[str, Any]:
        if self.node:
            return {"node": self.node, **self.values}
        return {"from": self.origin, "to": self.target, "one_way": self.one_way, **self.values}


def problem_of(name: str, value: object) -> str:
    """Why `value` cannot be the field `name`; empty when it can."""
    if name not in FIELDS:
        return f"there is no such field, known are {', '.join(FIELDS)}"
    if name == "down":
        return "" if isinstance(value, bool) else f"{value!r} is neither true nor false"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"{value!r} is not a number"
    return "" if 0 <= value <= LIMITS[name] else f"{value!r} is not between 0 and {LIMITS[name]:g}"


def from_state(state: Mapping[str, Any]) -> tuple[tuple[str, str], Link]:
    """One entry of the switch's answer to `get`."""
    return (state["from"], state["to"]), Link(**{name: state[name] for name in asdict(Link())})
