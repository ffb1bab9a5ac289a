"""A small piece of `scripts/bench storm`: two operators and two schedulers, hurt by the grant, judged at every revision."""

from collections.abc import Iterator

import pytest
from tests.support.seeds import daily_seed

from campaigns.rigs.live import POOLS
from campaigns.storm.campaign import Plan, Storm
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.live
GRANTS = 60


@pytest.fixture
def small_pool(installed_plane: ControlPlane) -> Iterator[ControlPlane]:
    """The default pool with fewer ids than are wished for, and a short rest."""
    path = f"{POOLS}/default"
    before = installed_plane.api.get(path)["spec"]
    installed_plane.api.patch(path, {"spec": {"ids": "1-12", "quarantineSeconds": 1}})
    yield installed_plane
    installed_plane.api.patch(path, {"spec": {key: before.get(key) for key in ("ids", "quarantineSeconds")}})


def test_in_a_storm_nothing_is_granted_twice_nothing_is_lost_and_nothing_is_left(small_pool: ControlPlane) -> None:
    seed = daily_seed()
    plan = Plan(wanted=40, robots=2, every=15, lose=0.03, kept=4, seed=seed)
    report = Storm(small_pool, plan).run(GRANTS)
    assert report.problems == [], f"seed {seed}, {report.figures}"
    assert report.verdict.grants >= GRANTS
    assert report.figures["kills"] + report.figures["stops"] > 0
