"""One operator for all tests of this folder, nodes, and a hand that binds pods."""

import secrets
from collections.abc import Iterator

import pytest

from campaigns.rigs.live import HandBinder, Tenant, pool
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology
from robotapp_testbed.processes.process import Process


@pytest.fixture(scope="module")
def nodes(installed_plane: ControlPlane) -> Iterator[topology.Topology]:
    """Two robots, two edge servers, one cloud node."""
    fleet = topology.fleet()
    topology.apply(installed_plane, fleet)
    yield fleet
    topology.remove(installed_plane, fleet)


@pytest.fixture(scope="module")
def operator(installed_plane: ControlPlane, nodes: topology.Topology) -> Iterator[Process]:
    assert len(nodes) == 5
    process = product.start_operator(
        installed_plane, name=f"operator-{secrets.token_hex(2)}", sweep_seconds=1, no_leader_election=True
    )
    yield process
    process.stop()


@pytest.fixture
def ids(installed_plane: ControlPlane) -> Iterator[str]:
    """A pool of the test's own with all ids and a quarantine of one second."""
    with pool(installed_plane, f"pool-{secrets.token_hex(3)}") as name:
        yield name


@pytest.fixture
def tenant(installed_plane: ControlPlane, namespace: str) -> Iterator[Tenant]:
    """A namespace whose pods are bound by hand."""
    with HandBinder(installed_plane, namespace):
        yield Tenant(installed_plane, namespace)
