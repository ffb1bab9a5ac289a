"""teleop on real nodes: commands are answered from another node, and a robot whose link is cut for ten seconds stops and drives on."""

import logging

import pytest

from campaigns.reference.catalogue import EDGE, GENERATIONS, ROBOT, SCENARIOS
from campaigns.reference.real_nodes import describe, run_trial
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

SCENARIO = "teleop"


@pytest.mark.parametrize("ros", GENERATIONS)
def test_a_robot_stops_when_its_link_is_cut_and_drives_on_when_it_is_back(ros: int, cluster: RealNodes) -> None:
    trial = run_trial(cluster, SCENARIOS[SCENARIO], ros)
    logger.info("%s", describe(trial))
    assert not trial.broken, describe(trial)
    assert (trial.nodes["operator"], trial.nodes["robot"]) == (EDGE, ROBOT)
