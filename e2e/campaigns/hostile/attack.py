"""What an attack of `scripts/bench hostile` is: a function of a running site that returns figures and what missed its limit."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import yaml

from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed.control_plane.product import CHART

MIB: Final = 1 << 20
_UNITS: Final = {"Mi": 1 << 20, "Gi": 1 << 30}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Figures with their units in the names, and a sentence for each limit that was missed."""

    figures: Mapping[str, float]
    missed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Attack:
    """`run` gets a site of its own: control plane, nodes, a fresh operator and a fresh scheduler."""

    name: str
    text: str
    run: Callable[[SimulatedSite], Outcome]


ATTACKS: Final[dict[str, Attack]] = {}
"""Filled by `register` when the modules of `campaigns.hostile.attacks` are imported."""


def register(
    name: str, text: str
) -> Callable[[Callable[[SimulatedSite], Outcome]], Callable[[SimulatedSite], Outcome]]:
    """Adds the decorated function to `ATTACKS`. Raises ValueError for a name that is taken."""

    def add(run: Callable[[SimulatedSite], Outcome]) -> Callable[[SimulatedSite], Outcome]:
        if name in ATTACKS:
            raise ValueError(f"there are two attacks with the name {name}")
        ATTACKS[name] = Attack(name, text, run)
        return run

    return add


def judge(figures: Mapping[str, float], most: Mapping[str, float]) -> Outcome:
    """Returns the outcome: each figure named in `most` may be that large, and must be there."""
    failures = [f"{name} is not measured" for name in most if name not in figures]
    failures += [
        f"{name}: {figures[name]:.4g}, at most {limit:.4g} is allowed"
        for name, limit in most.items()
        if name in figures and not figures[name] <= limit
    ]
    return Outcome(dict(figures), tuple(failures))


def read_memory_limit(component: str) -> int:
    """Returns the bytes of memory that the chart's values give a component, such as "operator"."""
    values = yaml.safe_load((CHART / "values.yaml").read_text())
    text = str(values[component]["resources"]["limits"]["memory"])
    return int(text[:-2]) * _UNITS[text[-2:]]
