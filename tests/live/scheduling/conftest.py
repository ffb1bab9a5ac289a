from collections.abc import Iterator
from datetime import UTC, datetime

import pytest

from campaigns.rigs.quiet import refused_since
from campaigns.rigs.stage import Stage
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.processes.process import Process
from robotapp_testbed.pytest_plugin import running_plane


@pytest.fixture(scope="module")
def scheduler(installed_plane: ControlPlane) -> Iterator[Process]:
    """Our scheduler with the chart's rights, for the tests of one module."""
    process = start_scheduler(installed_plane, sweep_seconds=1, insecure_explain=True, log_format="text")
    yield process
    process.stop()


@pytest.fixture
def stage(installed_plane: ControlPlane, namespace: str) -> Stage:
    return Stage(installed_plane, namespace)


@pytest.fixture(scope="module", autouse=True)
def _needs_no_more_rights_than_the_chart_gives() -> Iterator[None]:
    """Every scheduler of these tests has the identity its pod would have: nothing it asks for may be refused."""
    began = datetime.now(UTC)
    yield
    plane = running_plane()
    refused = refused_since(plane, began) if plane is not None else set()
    assert not refused, f"the chart's role does not allow: {sorted(refused)}"
