"""The first screen: robots as rows, problems on top."""

from typing import Any

import pytest
from tests.unit.console.objects import (
    NOW_S,
    app,
    device_claim,
    instance,
    node,
    pool,
    resource_claim,
    resource_slice,
    snapshot,
    telemetry,
)

from robotapp_console.views.fleet import build_fleet, measure_links, read_fleet_query, take_fleet_page
from robotapp_console.views.paging import PAGE_ROWS
from robotapp_console.views.problems import MOST_SHOWN, find_problems


def test_a_robot_is_a_row_with_its_zone_nodes_apps_devices_and_load() -> None:
    row = build_fleet(
        snapshot(
            nodes=[
                node("amr-07", robot="amr-07", zone="hall-1", labels={"robotics.io/robot-primary": "true"}),
                node("amr-07-gpu", robot="amr-07", zone="hall-1"),
                node("edge-1", zone="hall-1"),
            ],
            reports=[
                telemetry(
                    "amr-07",
                    rtt={"edge-1": 2.0},
                    devices=[
                        {"id": "can-can0", "type": "can", "present": True},
                        {"id": "can-can1", "type": "can", "present": True},
                    ],
                    load={"cpuPercent": 12, "memoryPercent": 48},
                    battery={"percent": 80, "charging": True},
                    written_s=NOW_S - 2,
                )
            ],
            apps=[app("teleop")],
            instances=[instance("teleop", "amr-07")],
            claims=[device_claim("can-can0")],
        )
    ).rows[0]
    assert (row.robot, row.zone, row.nodes, row.link.text) == ("amr-07", "hall-1", ("amr-07", "amr-07-gpu"), "2 ms")
    assert [(chip.name, chip.phase, chip.colour) for chip in row.chips] == [("teleop", "Running", "good")]
    assert (row.held, row.free) == (1, 1)
    assert row.load is not None
    assert row.load.cpu_percent == 12
    assert row.battery is not None
    assert row.battery.charging
    assert not row.silent
    assert not row.offline_since


def test_devices_of_both_ledgers_count_as_held_and_none_as_free_while_one_ledger_may_not_be_read() -> None:
    devices = [{"id": f"can-can{number}", "type": "can", "present": True} for number in range(3)]
    parts: dict[str, Any] = {
        "nodes": [node("amr-07", robot="amr-07")],
        "reports": [telemetry("amr-07", devices=devices)],
        "claims": [device_claim("can-can0")],
        "slices": [resource_slice()],
    }
    fleet = build_fleet(snapshot(**parts, resource_claims=[resource_claim("can-can1")]))
    assert (fleet.rows[0].held, fleet.rows[0].free, fleet.counts["held"]) == (2, 1, 2)
    fleet = build_fleet(snapshot(**parts, refused=("resourceclaims",)))
    assert (fleet.rows[0].held, fleet.rows[0].free, fleet.counts["held"]) == (1, 0, None)
    assert [refusal.what for refusal in fleet.refusals] == ["resourceclaims"]


def test_without_the_right_to_read_nodes_robots_are_known_by_their_instances() -> None:
    fleet = build_fleet(snapshot(apps=[app("teleop")], instances=[instance("teleop", "amr-07")], refused=("nodes",)))
    assert [row.robot for row in fleet.rows] == ["amr-07"]
    assert [refusal.what for refusal in fleet.refusals] == ["nodes"]


def test_what_a_silent_agent_reported_counts_no_more() -> None:
    row = build_fleet(
        snapshot(
            nodes=[node("amr-07", robot="amr-07", zone="h"), node("edge-1", zone="h")],
            reports=[
                telemetry("amr-07", rtt={"edge-1": 2.0}, load={"cpuPercent": 12}, written_s=NOW_S - 31),
            ],
        )
    ).rows[0]
    assert row.silent
    assert row.load is None
    assert row.link.p95_us is None


def test_a_node_that_is_not_ready_makes_its_robot_offline() -> None:
    row = build_fleet(snapshot(nodes=[node("amr-07", robot="amr-07", ready="Unknown")])).rows[0]
    assert row.offline_since
    assert row.is_troubled


def test_apps_in_trouble_stand_first_and_are_marked() -> None:
    row = build_fleet(
        snapshot(
            apps=[app("a"), app("z", troubled=[{"instance": "amr-07", "reason": "BudgetExceeded", "message": "m"}])],
            instances=[instance("a", "amr-07"), instance("z", "amr-07")],
        )
    ).rows[0]
    assert [(chip.name, chip.troubled) for chip in row.chips] == [("z", True), ("a", False)]
    assert row.is_troubled


def test_apps_without_a_robot_are_listed_apart() -> None:
    fleet = build_fleet(snapshot(apps=[app("minimal")], instances=[instance("minimal")]))
    assert fleet.rows == ()
    assert [chip.name for chip in fleet.loose] == ["minimal"]


def test_figures_count_what_there_is() -> None:
    fleet = build_fleet(
        snapshot(
            nodes=[node("a", robot="a", ready="False"), node("b", robot="b")],
            apps=[app("x"), app("y", phase="Degraded")],
            claims=[device_claim("can-can0")],
        )
    )
    assert fleet.counts == {"robots": 2, "offline": 1, "apps": 2, "running": 1, "held": 1, "domains": 0}


def test_what_may_not_be_read_is_not_counted_as_nothing() -> None:
    fleet = build_fleet(snapshot(refused=("robotclaims", "nodes")))
    assert fleet.counts == {"robots": 0, "offline": None, "apps": 0, "running": 0, "held": None, "domains": None}
    assert build_fleet(snapshot(refused=("robotappinstances", "nodes"))).counts["robots"] is None


def test_a_thousand_robots_come_in_pages_that_keep_their_order() -> None:
    fleet = build_fleet(
        snapshot(nodes=[node(f"amr-{i:04}", robot=f"amr-{i:04}", zone=f"z{i % 3}") for i in range(1000)])
    )
    seen: list[str] = []
    for number in range(1, 21):
        page = take_fleet_page(fleet, read_fleet_query({"page": str(number)}))
        assert (page.total, page.pages, len(page.rows)) == (1000, 20, PAGE_ROWS)
        seen += [row.robot for row in page.rows]
    assert seen == sorted(seen)
    assert len(set(seen)) == 1000
    assert take_fleet_page(fleet, read_fleet_query({"page": "99"})).number == 20


@pytest.mark.parametrize(
    ("parameters", "robots"),
    [
        ({"q": "amr-1"}, ["amr-1"]),
        ({"q": "HALL-2"}, ["amr-2", "amr-3"]),
        ({"q": "teleop"}, ["amr-1"]),
        ({"q": "hall amr-3"}, ["amr-3"]),
        ({"zone": "hall-1"}, ["amr-1"]),
        ({"state": "idle"}, ["amr-2", "amr-3"]),
        ({"state": "offline"}, ["amr-3"]),
        ({"state": "troubled"}, ["amr-3"]),
        ({"sort": "zone", "desc": "1"}, ["amr-3", "amr-2", "amr-1"]),
        ({"sort": "apps"}, ["amr-3", "amr-1", "amr-2"]),
        ({"sort": "no such column", "page": "no number"}, ["amr-1", "amr-2", "amr-3"]),
    ],
)
def test_the_address_filters_and_orders(parameters: dict[str, str], robots: list[str]) -> None:
    fleet = build_fleet(
        snapshot(
            nodes=[
                node("amr-1", robot="amr-1", zone="hall-1"),
                node("amr-2", robot="amr-2", zone="hall-2"),
                node("amr-3", robot="amr-3", zone="hall-2", ready="Unknown"),
            ],
            apps=[app("teleop")],
            instances=[instance("teleop", "amr-1")],
        )
    )
    page = take_fleet_page(fleet, read_fleet_query(parameters))
    assert [row.robot for row in page.rows] == robots


def test_every_link_of_a_page_keeps_what_was_chosen() -> None:
    fleet = build_fleet(snapshot(nodes=[node(f"amr-{i:03}", robot=f"amr-{i:03}", zone="hall") for i in range(120)]))
    chosen = {"q": "amr", "zone": "hall", "namespace": "team-a", "page": "2", "sort": "zone"}
    page = take_fleet_page(fleet, read_fleet_query(chosen))
    shared = "?q=amr&zone=hall&namespace=team-a&sort=zone"
    assert (page.previous, page.following) == (f"{shared}&page=1", f"{shared}&page=3")
    assert page.query.encode_sort("zone") == f"{shared}&desc=1"
    assert page.query.is_narrowed
    assert not read_fleet_query({"namespace": "team-a"}).is_narrowed


@pytest.mark.parametrize("sort", ["robot", "zone", "link", "apps", "devices", "load", "battery"])
def test_every_order_takes_robots_of_which_nothing_is_known(sort: str) -> None:
    fleet = build_fleet(
        snapshot(
            nodes=[node("a", robot="a"), node("b", robot="b", zone="z"), node("c", zone="z")],
            reports=[telemetry("b", rtt={"c": 1.0}, battery={"percent": 5}, load={"cpuPercent": 1}, written_s=NOW_S)],
            instances=[instance("x", "gone")],
        )
    )
    assert len(take_fleet_page(fleet, read_fleet_query({"sort": sort})).rows) == 3


# Problems


@pytest.mark.parametrize(
    ("reason", "command"),
    [
        ("DeviceBusy", "kubectl robotapp devices"),
        ("DomainExhausted", "kubectl robotapp domains"),
        ("Unschedulable", "kubectl robotapp explain teleop -n default --robot amr-07"),
        ("BudgetExceeded", "kubectl robotapp explain teleop -n default --robot amr-07"),
        ("RobotOffline", "kubectl robotapp robots"),
        ("ImagePullFailed", "kubectl describe pods -n default -l robotics.io/app=teleop"),
        ("CrashLoop", "kubectl logs -n default -l robotics.io/app=teleop --all-containers --prefix --tail=50"),
        ("SomethingNew", "kubectl robotapp info teleop -n default --robot amr-07"),
    ],
)
def test_each_problem_names_the_command_that_helps(reason: str, command: str) -> None:
    troubled = [{"instance": "amr-07", "reason": reason, "message": "what is wrong"}]
    (problem,) = find_problems(snapshot(apps=[app("teleop", troubled=troubled)])).listed
    assert (problem.subject, problem.message) == ("default/teleop on amr-07", "what is wrong")
    assert (problem.command, problem.href) == (command, "/apps/default/teleop?robot=amr-07")


@pytest.mark.parametrize(
    ("used", "reason"),
    [
        ("12/119", None),
        ("107/119", None),
        ("108/119", "PoolNearlyFull"),
        ("119/119", "PoolFull"),
        ("", None),
        ("0/0", None),
    ],
)
def test_a_pool_is_a_problem_from_nine_tenths_on(used: str, reason: str | None) -> None:
    problems = find_problems(snapshot(pools=[pool(used=used, quarantined=3)])).listed
    assert [problem.reason for problem in problems] == ([reason] if reason else [])


def test_full_pools_come_first_and_unclear_robots_last() -> None:
    problems = find_problems(
        snapshot(
            pools=[pool(used="119/119")],
            apps=[app("teleop", troubled=[{"reason": "CrashLoop"}])],
            nodes=[node("a-1", robot="a"), node("a-2", robot="a")],
        )
    ).listed
    assert [problem.subject for problem in problems] == ["pool default", "default/teleop", "robot a"]
    assert "robotics.io/robot-primary=true" in problems[2].command


def test_many_problems_are_counted_and_the_first_shown() -> None:
    apps = [app(f"a{i:03}", troubled=[{"reason": "CrashLoop"}]) for i in range(MOST_SHOWN + 5)]
    problems = find_problems(snapshot(apps=apps))
    assert (len(problems.listed), problems.total) == (MOST_SHOWN, MOST_SHOWN + 5)


def test_links_of_robots_are_measured_for_the_history() -> None:
    links = measure_links(
        snapshot(
            nodes=[node("amr-07", robot="amr-07", zone="h"), node("edge-1", zone="h")],
            reports=[telemetry("amr-07", rtt={"edge-1": 2.0}, written_s=NOW_S)],
        )
    )
    assert links == {"amr-07": 2000.0}
