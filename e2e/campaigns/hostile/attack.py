"""An attack of `scripts/bench hostile`: a function of a running site that returns figures and what missed its limit."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import yaml

from campaigns.common.process_use import tree_rss_bytes
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import Process, wait_until
from robotapp_testbed.control_plane.product import CHART
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import fleet

MIB: Final = 1 << 20
RETURNED_MIB: Final = 16.0
REST_S: Final = 60.0
"""Longer than every deadline of a port: by then memory must be back, but for `RETURNED_MIB`."""
READY_S: Final = 3.0
"""Within this others' apps become Ready during every attack."""
_UNITS: Final = {"Mi": 1 << 20, "Gi": 1 << 30}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Figures with their units in the names, and a sentence for each limit that was missed."""

    figures: Mapping[str, float]
    missed: tuple[str, ...] = ()


Run = Callable[[SimulatedSite], Outcome]


def make_nodes() -> Topology:
    """Returns the nodes of a site on which the attack does not choose its own."""
    return fleet(robots=4, edges=4)


@dataclass(frozen=True, slots=True)
class Attack:
    """`run` gets a site of its own: namespace, `nodes`, a fresh operator and a fresh scheduler."""

    name: str
    text: str
    run: Run
    nodes: Callable[[], Topology] = make_nodes


ATTACKS: Final[dict[str, Attack]] = {}
"""Filled by `register` when the modules of `campaigns.hostile.attacks` are imported."""


def register(name: str, text: str, *, nodes: Callable[[], Topology] = make_nodes) -> Callable[[Run], Run]:
    """Adds the decorated function to `ATTACKS`. Raises ValueError for a name that is taken."""

    def add(run: Run) -> Run:
        if name in ATTACKS:
            raise ValueError(f"there are two attacks with the name {name}")
        ATTACKS[name] = Attack(name, text, run, nodes)
        return run

    return add


def measure_kept(process: Process, before_bytes: int) -> float:
    """Returns the MiB that a process and those below it do not give back once an attack has ended."""

    def count_kept() -> float:
        return (tree_rss_bytes(process.pid) - before_bytes) / MIB

    wait_until(lambda: count_kept() <= RETURNED_MIB, timeout_s=REST_S, poll_s=1.0)
    return count_kept()


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
    text = str(read_values()[component]["resources"]["limits"]["memory"])
    return int(text[:-2]) * _UNITS[text[-2:]]


def read_quota() -> int:
    """Returns how many ids of the pool the chart's values give a namespace."""
    return int(read_values()["domainPool"]["quota"]["default"])


def read_values() -> dict[str, Any]:
    """Returns the chart's values."""
    values: dict[str, Any] = yaml.safe_load((CHART / "values.yaml").read_text())
    return values
