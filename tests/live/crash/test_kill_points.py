"""Operator and scheduler killed -9 at a rotating sample of their writes; scripts/bench crash --all runs every one."""

from collections.abc import Iterator

import pytest
from tests.support.seeds import daily_seed

from campaigns.crash.crash import CrashCampaign, kill_points, lives, sample
from robotapp_testbed import ControlPlane

SAMPLE = 15
KILLS_PER_LIFE = 5


@pytest.fixture(scope="module")
def campaign() -> Iterator[CrashCampaign]:
    with ControlPlane() as cp, CrashCampaign(cp) as running:
        yield running


@pytest.mark.live
@pytest.mark.timeout(1800)
def test_whoever_dies_at_whichever_write_every_app_becomes_ready_and_nothing_is_doubled_or_left(
    campaign: CrashCampaign,
) -> None:
    points = list(kill_points(campaign.reference()))
    assert len(points) >= 120
    outcomes = [campaign.live(each) for each in lives(sample(points, SAMPLE, daily_seed()), KILLS_PER_LIFE)]
    problems = {str(each.points): each.problems for each in outcomes if each.problems}
    assert problems == {}, f"repeat with ROBOTAPP_SEED={daily_seed()}"
    assert sum(len(each.missed) for each in outcomes) < SAMPLE // 2
