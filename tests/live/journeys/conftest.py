"""The world journeys run in: operator and scheduler of this module's own on the session's control plane."""

import secrets
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.topology import fleet

ROBOTS = 10


@dataclass(frozen=True, slots=True)
class Pools:
    """Names of pools that only this module uses: two of twelve ids, of which the second is spare, and one of four."""

    twelve: str
    spare: str
    four: str


@pytest.fixture(scope="module")
def pools() -> Pools:
    mark = secrets.token_hex(3)
    return Pools(f"twelve-{mark}", f"spare-{mark}", f"four-{mark}")


@pytest.fixture(scope="module")
def running(installed_plane: ControlPlane, pools: Pools) -> Iterator[SimulatedSite]:
    mark = secrets.token_hex(2)
    nodes = fleet(
        robots=[f"amr-{mark}-{number}" for number in range(ROBOTS)],
        edges=[f"edge-{mark}-{number}" for number in range(2)],
        clouds=[f"cloud-{mark}"],
    )
    with SimulatedSite(
        installed_plane, nodes, pools={pools.twelve: "1-12", pools.spare: "1-12", pools.four: "1-4"}
    ) as world:
        yield world


@pytest.fixture
def world(running: SimulatedSite) -> Iterator[SimulatedSite]:
    """Without apps at the beginning; whatever the test applied is deleted afterwards, claims included."""
    yield running
    running.clear()
