"""navigation on real nodes: a robot that is offline stops, and reaches its goal when it is back."""

import logging

import pytest

from campaigns.reference.catalogue import CLOUD, GENERATIONS, ROBOT, SCENARIOS
from campaigns.reference.real_nodes import describe, run_trial
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

SCENARIO = "navigation"
OUTAGE_S = 10.0
"""The bench takes a minute."""


@pytest.mark.parametrize("ros", GENERATIONS)
def test_a_robot_that_is_offline_stops_and_reaches_its_goal_when_it_is_back(ros: int, cluster: RealNodes) -> None:
    trial = run_trial(cluster, SCENARIOS[SCENARIO], ros, outage_s=OUTAGE_S)
    logger.info("%s", describe(trial))
    assert not trial.broken, describe(trial)
    assert (trial.nodes["planner"], trial.nodes["robot"]) == (CLOUD, ROBOT)
