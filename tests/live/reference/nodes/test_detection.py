"""detection on real nodes: nine of ten signs are found from another node, also by the detector that follows a killed one."""

import logging

import pytest

from campaigns.reference.catalogue import GENERATIONS, ROBOT, SCENARIOS
from campaigns.reference.real_nodes import describe, run_trial
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

SCENARIO = "detection"


@pytest.mark.parametrize("ros", GENERATIONS)
def test_the_detector_that_follows_a_killed_one_finds_nine_of_ten_signs_in_later_pictures(
    ros: int, cluster: RealNodes
) -> None:
    trial = run_trial(cluster, SCENARIOS[SCENARIO], ros)
    logger.info("%s", describe(trial))
    assert not trial.broken, describe(trial)
    assert trial.nodes["camera"] == ROBOT != trial.nodes["detector"]
