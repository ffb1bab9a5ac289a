"""The thesis' scenarios on random clusters, ours beside kube-scheduler: five repetitions of another seed every day."""

import pytest
from tests.support.seeds import daily_seed

from campaigns.scenarios.catalogue import SCENARIOS
from campaigns.scenarios.contenders import KUBE_SCHEDULER, OURS
from campaigns.scenarios.scenarios import Campaign, Outcome, line
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.live

REPETITIONS = 5
MOST_NODES = 60
"""Of 200 in the long run (scripts/bench scenarios): creating and deleting nodes takes most of the time."""
KNOWN_TO_BOTH = frozenset({"shared-volume", "node-volume"})
"""Rules of Kubernetes itself. That kube-scheduler keeps them shows that the scenarios are played fairly."""


@pytest.mark.timeout(1200)
def test_every_scenario_of_the_thesis_holds_under_our_scheduler(installed_plane: ControlPlane) -> None:
    found: list[Outcome] = []
    campaign = Campaign(installed_plane, list(SCENARIOS.values()), seed=daily_seed(), most_nodes=MOST_NODES)
    campaign.run(range(REPETITIONS), found.append)
    missed = [each for each in found if each.contender == OURS.name and not each.verdict.met]
    assert missed == [], f"seed {daily_seed()}:\n" + "\n".join(map(line, missed))
    theirs = [each for each in found if each.contender == KUBE_SCHEDULER.name]
    assert all(each.verdict.met for each in theirs if each.scenario in KNOWN_TO_BOTH)
    assert not all(each.verdict.met for each in theirs), "kube-scheduler does not know the annotations"
