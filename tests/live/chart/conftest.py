"""One control plane for the chart's tests: an installation is cluster-wide, so it must not meet the other tests'."""

from collections.abc import Iterator

import pytest
from tests.live.chart.chart import Chart, Object

from robotapp_testbed import ControlPlane

ALL_FLAGS = {
    "metrics.podMonitor.enabled": "true",
    "metrics.serviceMonitor.enabled": "true",
    "networkPolicy.enabled": "true",
    "imagePullSecrets[0]": "pull",
    "commonLabels.team": "fleet",
    "operator.podAnnotations.note": "kept",
    "operator.nodeSelector.disk": "ssd",
}


@pytest.fixture(scope="session")
def chart() -> Iterator[Chart]:
    with ControlPlane(kwok=False, controller_manager=True) as plane:
        yield Chart(plane)


@pytest.fixture(scope="module")
def rendered(chart: Chart) -> list[Object]:
    return chart.render(ALL_FLAGS)
