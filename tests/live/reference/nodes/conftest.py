"""A cluster of real nodes per module, for both generations of its scenario, with everything of the chart as pods."""

from collections.abc import Iterator

import pytest

from campaigns.reference.catalogue import SCENARIOS
from campaigns.reference.real_nodes import start_cluster
from robotapp_testbed.binaries import pins
from robotapp_testbed.real import RealNodes


@pytest.fixture(scope="module")
def cluster(request: pytest.FixtureRequest, real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    """Starts the nodes of the scenario that the module's SCENARIO names."""
    del real_machine  # skips where this machine cannot have real nodes
    if pins.platform_names()["arch"] != "amd64":
        pytest.skip("wheels of rclpy are for amd64 alone")
    with start_cluster([SCENARIOS[request.module.SCENARIO]]) as cp:
        yield cp
