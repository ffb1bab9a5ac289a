"""fleet on real nodes: the next coordinator finds on its volume what the killed one promised, and each task is done exactly once."""

import logging

import pytest

from campaigns.reference.catalogue import EDGE, FLEET, GENERATIONS, SCENARIOS
from campaigns.reference.real_nodes import describe, run_trial
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

SCENARIO = "fleet"


@pytest.mark.parametrize("ros", GENERATIONS)
def test_each_task_is_done_once_although_the_coordinator_is_replaced_on_the_way(ros: int, cluster: RealNodes) -> None:
    trial = run_trial(cluster, SCENARIOS[SCENARIO], ros)
    logger.info("%s", describe(trial))
    assert not trial.broken, describe(trial)
    assert trial.nodes["coordinator"] == EDGE
    assert {trial.nodes[f"robot-{number}"] for number in (1, 2, 3)} == set(FLEET)
