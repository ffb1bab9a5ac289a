"""Random objects that fit their schema harm nobody: 200 here, thousands by `scripts/bench fuzz`."""

import pytest
from tests.support.seeds import daily_seed

from campaigns.fuzz.campaign import Campaign
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.topology import fleet

pytestmark = pytest.mark.live
OBJECTS = 200


@pytest.mark.timeout(600)
def test_no_process_ends_no_log_has_a_traceback_and_healthy_apps_become_ready(installed_plane: ControlPlane) -> None:
    mark = f"fuzz{daily_seed() % 1000}"
    nodes = fleet(robots=[f"amr-{mark}"], edges=[f"edge-{mark}"], clouds=0)
    with SimulatedSite(installed_plane, nodes, pools={f"pool-{mark}": "1-101"}) as world:
        report = Campaign(world, seed=daily_seed(), pool=f"pool-{mark}").run(OBJECTS)
    assert report.problems == [], f"repeat with ROBOTAPP_SEED={daily_seed()}"
    assert report.objects == OBJECTS
    for kind in ("RobotApp", "RobotClaim", "Rigelfile", "pod", "telemetry"):
        assert report.sent[f"{kind} accepted"] > 0, report.sent
    assert not [kind for kind in report.sent if "answered with" in kind], report.sent
