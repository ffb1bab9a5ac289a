from collections.abc import Iterator

import pytest
from tests.support.stage import Stage

from robotapp_testbed import ControlPlane
from robotapp_testbed.process import Process
from robotapp_testbed.product import start_scheduler


@pytest.fixture(scope="module")
def scheduler(installed_plane: ControlPlane) -> Iterator[Process]:
    """Our scheduler with the chart's rights, for the tests of one module."""
    process = start_scheduler(installed_plane, sweep_seconds=1, insecure_explain=True, log_format="text")
    yield process
    process.stop()


@pytest.fixture
def stage(installed_plane: ControlPlane, namespace: str) -> Stage:
    return Stage(installed_plane, namespace)
