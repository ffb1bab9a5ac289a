"""Many apps at once, more apps than domains, one app on many robots, and silence when nothing changes."""

from datetime import UTC, datetime

import pytest
from tests.live.journeys.conftest import ROBOTS, Pools

from campaigns.rigs import journeys, quiet
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from robotapp_testbed.control_plane.identity import OPERATOR_ACCOUNT, SCHEDULER_ACCOUNT

pytestmark = pytest.mark.live


def test_twenty_apps_applied_at_once_are_ready_with_distinct_domains_in_each_pool(
    world: SimulatedSite, pools: Pools
) -> None:
    found = journeys.storm(world, [pools.twelve, pools.spare], apps=20, within_s=120)
    assert found.problems == ()
    assert found.domains == {pools.twelve: 10, pools.spare: 10}


def test_apps_beyond_the_pool_wait_and_are_told_what_to_do_and_start_when_others_go(
    world: SimulatedSite, pools: Pools
) -> None:
    found = journeys.overflow(world, pools.four, size=4, apps=6, within_s=120)
    assert found.problems == ()
    assert (found.ready, found.waiting) == (4, 2)
    for message in found.messages:
        for part in ("4 of 4", pools.four, "delete", "DomainPool", "spec.ros2.pool"):
            assert part in message


def test_an_app_for_each_robot_has_as_many_domains_as_robots(world: SimulatedSite, pools: Pools) -> None:
    found = journeys.one_per_robot(world, pool=pools.spare, within_s=120)
    assert found.problems == ()
    assert found.domains == {pools.spare: ROBOTS}


def test_nothing_is_written_while_nothing_changes(world: SimulatedSite, pools: Pools) -> None:
    began = datetime.now(UTC)
    names = [f"calm-{number}" for number in range(3)]
    world.create_all([plain_app(name, ros2={"pool": pools.twelve}) for name in names])
    world.watch.until_ready(*names, within_s=120)
    writers = {each.partition(" ")[0] for each in quiet.by_object(quiet.writes_since(world.cp, began))}
    assert writers == {OPERATOR_ACCOUNT, SCHEDULER_ACCOUNT}  # the log does show who writes
    at_rest = quiet.until_quiet(world.cp, quiet_s=quiet.REST_S, within_s=120)
    assert at_rest, quiet.by_object(quiet.writes_during(world.cp, 3.0))
    assert quiet.by_object(quiet.writes_during(world.cp, 10.0)) == {}
