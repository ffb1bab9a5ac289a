"""One control plane for the chart's tests: an installation is cluster-wide, so it must not meet the other tests'."""

from collections.abc import Iterator

import pytest
from tests.support.chart import Chart

from robotapp_testbed import ControlPlane


@pytest.fixture(scope="session")
def chart() -> Iterator[Chart]:
    with ControlPlane(kwok=False, controller_manager=True) as plane:
        yield Chart(plane)
