"""The scheduler that tests of jobs and sweeps start beside the operator."""

import secrets
from collections.abc import Iterator

import pytest

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.processes.process import Process


@pytest.fixture(scope="module")
def scheduler(installed_plane: ControlPlane, operator: Process) -> Iterator[Process]:
    """Our scheduler."""
    assert operator.running
    process = product.start_scheduler(installed_plane, name=f"scheduler-{secrets.token_hex(3)}", sweep_seconds=1)
    yield process
    process.stop()
