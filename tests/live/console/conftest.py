"""The console as the chart runs it, in front of a real API server with an operator and two nodes."""

import secrets
from collections.abc import Iterator

import pytest
from tests.live.console.browsing import Console, serve

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology

ROBOT = "amr-console"


@pytest.fixture(scope="module")
def console(installed_plane: ControlPlane) -> Iterator[Console]:
    with serve(installed_plane) as console:
        yield console


@pytest.fixture(scope="module")
def fleet(installed_plane: ControlPlane) -> Iterator[None]:
    """A robot and an edge server with telemetry, and an operator; nothing places pods."""
    nodes = topology.fleet([ROBOT], 1, 0)
    topology.apply(installed_plane, nodes)
    name = f"operator-{secrets.token_hex(2)}"
    operator = product.start_operator(installed_plane, name=name, sweep_seconds=1, no_leader_election=True)
    with topology.SimulatedTelemetry(installed_plane, nodes):
        yield
    operator.stop()
    topology.remove(installed_plane, nodes)
