"""The console as the chart runs it, in front of a real API server with an operator and two nodes."""

import json
import re
import secrets
import subprocess
import sys
from collections.abc import Iterator

import pytest
from tests.live.console.browsing import Console

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology

ROBOT = "amr-console"


@pytest.fixture(scope="module")
def console(installed_plane: ControlPlane) -> Iterator[Console]:
    command = [sys.executable, "-m", "robotapp_console", "--plain-http", "--listen=127.0.0.1", "--port=0"]
    command += [f"--api-server={installed_plane.server_url}", f"--certificate-authority={installed_plane.ca_file}"]
    with subprocess.Popen([*command, "--log-format=json"], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = json.loads(process.stderr.readline())["message"]
        port = re.search(r"port (\d+)", line)
        assert port is not None, line
        yield Console(process, int(port[1]))
        process.terminate()
        assert process.wait(30) == 0


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
