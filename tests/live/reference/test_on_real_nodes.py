"""Applications of examples/reference on real nodes, as their robotapp.yaml says, with the environment that the operator generates."""

import logging
import re
import time
from collections.abc import Iterator

import pytest
from tests.live.reference.apps import read_app, read_log
from tests.support.work_unit import slowness

from campaigns.nodes import teleop_app
from robotapp_testbed import wait_until
from robotapp_testbed.binaries import pins
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.real import RealNodes

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(pins.platform_names()["arch"] != "amd64", reason="wheels of rclpy are for amd64 alone"),
]

logger = logging.getLogger(__name__)

APP = "teleop-ros2"
PLACE = "reference"
STARTED_S = 90.0
ANSWERED = 100
CUT_S = 10.0
HEALS_S = 20.0
"""Time after which commands are answered again, where `slowness` is 1."""


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes, delays = [robot("amr-07"), edge("edge-1")], {("amr-07", "edge-1"): 2}
    with real_machine(nodes, delays=delays, images=(APP,), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp)
        product.start_scheduler(cp)
        with created(cp, PLACE):
            teleop_app.apply(cp, PLACE, [read_app(APP, {"operator": "Edge"})])
            yield cp


def count_answers(cp: RealNodes) -> int:
    summaries = re.findall(r"commands, (\d+) answered", read_log(cp, PLACE, APP, "operator"))
    return int(summaries[-1]) if summaries else 0


def test_a_robot_stops_when_its_link_is_cut_and_drives_on_when_it_is_back(cluster: RealNodes) -> None:
    assert wait_until(lambda: count_answers(cluster) >= ANSWERED, timeout_s=STARTED_S * slowness(), poll_s=0.5)
    logger.info("%s", read_log(cluster, PLACE, APP, "operator").splitlines()[-1])
    stops = read_log(cluster, PLACE, APP, "robot").count("stopped")
    cluster.switch.set_link("amr-07", "edge-1", down=True)
    began_s = time.monotonic()
    assert wait_until(lambda: read_log(cluster, PLACE, APP, "robot").count("stopped") > stops, timeout_s=CUT_S)
    time.sleep(max(CUT_S - (time.monotonic() - began_s), 0))
    cluster.switch.set_link("amr-07", "edge-1", down=False)
    answered, allowed_s, began_s = count_answers(cluster), HEALS_S * slowness(), time.monotonic()
    assert wait_until(lambda: count_answers(cluster) > answered + ANSWERED, timeout_s=allowed_s, poll_s=0.2)
    logger.info("%d more answers %.1f s after the link was back", ANSWERED, time.monotonic() - began_s)
    pods = teleop_app.pods(cluster, PLACE, APP)
    assert {name: pod["spec"]["nodeName"] for name, pod in pods.items()} == {"operator": "edge-1", "robot": "amr-07"}
    restarts = [status["restartCount"] for pod in pods.values() for status in pod["status"]["containerStatuses"]]
    assert restarts == [0, 0]
