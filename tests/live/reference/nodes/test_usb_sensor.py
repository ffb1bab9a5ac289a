"""usb-sensor on real nodes: our driver hands the port to a container without privileges, and again after it was unplugged."""

import logging

import pytest

from campaigns.reference.catalogue import EDGE, GENERATIONS, ROBOT, SCENARIOS
from campaigns.reference.real_nodes import describe, run_trial
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

SCENARIO = "usb-sensor"


@pytest.mark.parametrize("ros", GENERATIONS)
def test_readings_arrive_from_another_node_and_arrive_again_after_the_sensor_was_unplugged(
    ros: int, cluster: RealNodes
) -> None:
    trial = run_trial(cluster, SCENARIOS[SCENARIO], ros)
    logger.info("%s", describe(trial))
    assert not trial.broken, describe(trial)
    assert (trial.nodes["driver"], trial.nodes["listener"]) == (ROBOT, EDGE)
