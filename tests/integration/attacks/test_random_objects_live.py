"""Random objects that fit their schema harm nobody: 200 here, thousands by `scripts/bench fuzz`."""

import datetime as dt
import os

import pytest
from tests.support.fuzz.campaign import Campaign
from tests.support.world import World

from robotapp_testbed import ControlPlane
from robotapp_testbed.topology import fleet

pytestmark = pytest.mark.live
OBJECTS = 200


def seed() -> int:
    """Other objects every day; ROBOTAPP_SEED repeats a day's."""
    return int(os.environ.get("ROBOTAPP_SEED", "0")) or dt.datetime.now(tz=dt.UTC).toordinal()


@pytest.mark.timeout(300)
def test_no_process_ends_no_log_has_a_traceback_and_healthy_apps_become_ready(installed_plane: ControlPlane) -> None:
    mark = f"fuzz{seed() % 1000}"
    nodes = fleet(robots=[f"amr-{mark}"], edges=[f"edge-{mark}"], clouds=0)
    with World(installed_plane, nodes, pools={f"pool-{mark}": "1-101"}) as world:
        report = Campaign(world, seed=seed(), pool=f"pool-{mark}").run(OBJECTS)
    assert report.problems == [], f"repeat with ROBOTAPP_SEED={seed()}"
    assert report.objects == OBJECTS
    assert report.sent["RobotApp accepted"] > 0
    assert not [kind for kind in report.sent if "answered with" in kind], report.sent
