"""Which instances need somebody, worst first."""

import dataclasses
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import make_app, round_trips, telemetry

from robotapp_api.model.names import Reason
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.spec.validate import Problem
from robotapp_operator.plan.status.components import ComponentView
from robotapp_operator.plan.status.device_loss import LostDevice
from robotapp_operator.plan.status.facts import AppFacts, Grace, InstanceFacts
from robotapp_operator.plan.status.latency import edge_views, worst_first
from robotapp_operator.plan.status.troubled import MAX_TROUBLED, troubled

UP = ComponentView(name="driver", replicas=1, ready=True, exists=True, bound=True, rolling=False, nodes=("edge-1",))
STARTING = dataclasses.replace(UP, ready=False)


def instance(robot: str, component: ComponentView = UP, *, problem: str = "", **fields: Any) -> InstanceFacts:
    node = "" if problem else f"n-{robot}"
    return InstanceFacts(instance=Instance(robot, node, problem), components=(component,), domain=7, **fields)


def failing(reason: Reason, message: str = "why") -> ComponentView:
    return dataclasses.replace(STARTING, reason=reason, message=message)


def over_budget() -> Any:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}
    placed = {"operator": "edge-1", "driver": "amr"}
    table = {"edge-1": telemetry("edge-1", amr=99)}
    return worst_first(
        edge_views(make_app(edges=[edge]).spec.edges, placed=placed, robot_node="", round_trips=round_trips(table))
    )


def named(*instances: InstanceFacts, **facts: Any) -> list[tuple[str, str]]:
    found = troubled(AppFacts(app=make_app(), instances=instances, now="2026-01-01T00:00:00Z", **facts))
    return [(item["instance"], item["reason"]) for item in found]


KINDS = [
    instance("a", STARTING, problem="label a node"),
    instance("b", STARTING, refusal=(Reason.DOMAIN_EXHAUSTED, "full")),
    instance("c", STARTING, trouble=(Reason.QUOTA_REFUSED, "too many")),
    instance("d", failing(Reason.CRASH_LOOP)),
    instance("e", STARTING, robot_online=False),
    instance("ee", STARTING, robot_online=False, grace=Grace("then", "later", 300.0)),
    instance("f", failing(Reason.UNSCHEDULABLE)),
    instance("g", STARTING, busy="held by x"),
    instance("gg", lost=(LostDevice("driver", "dev.x", "p", "cam", "n-gg"),)),
    instance("h", problem="label a node"),
    instance("i", cut_off=("driver-1",)),
    instance("j", edges=over_budget()),
]
ORDER = [
    ("a", "RobotNodeUnclear"),
    ("b", "DomainExhausted"),
    ("c", "QuotaRefused"),
    ("d", "CrashLoop"),
    ("e", "RobotOffline"),
    ("ee", "RobotNotReady"),
    ("f", "Unschedulable"),
    ("g", "DeviceBusy"),
    ("gg", "DeviceLost"),
    ("h", "RobotNodeUnclear"),
    ("i", "RestartNeeded"),
    ("j", "BudgetExceeded"),
]


@given(st.permutations(KINDS))
def test_worst_come_first_whatever_their_order(instances: list[InstanceFacts]) -> None:
    assert named(*instances) == ORDER[:MAX_TROUBLED], "the best of too many is left out"


def test_who_is_well_or_merely_starts_is_not_named() -> None:
    assert named(instance("a"), instance("b", STARTING)) == []


def test_no_more_than_ten_are_named() -> None:
    crowd = [instance(f"r-{number:02}", failing(Reason.CRASH_LOOP)) for number in range(20)]
    assert [name for name, _ in named(*crowd)] == [f"r-{number:02}" for number in range(MAX_TROUBLED)]


def test_a_refused_or_suspended_app_names_nobody() -> None:
    assert named(*KINDS, problems=(Problem(Reason.INVALID_SPEC, "spec", "wrong"),)) == []
    app = make_app(suspend=True)
    assert troubled(AppFacts(app=app, instances=tuple(KINDS), now="2026-01-01T00:00:00Z")) == []


def test_messages_tell_the_component_and_fit() -> None:
    (item,) = troubled(
        AppFacts(
            app=make_app(),
            instances=(instance("a", failing(Reason.CRASH_LOOP, "ö" * 2000)),),
            now="2026-01-01T00:00:00Z",
        )
    )
    assert item["message"].startswith("driver: ö")
    assert len(item["message"].encode()) <= 1024


def test_a_robot_out_of_sight_is_trouble_whether_its_last_pods_were_ready_or_not_and_says_what_to_bring_back() -> None:
    away = [
        InstanceFacts(instance=Instance("a", missing=True), components=(part,), domain=7) for part in (UP, STARTING)
    ]
    for facts in away:
        (item,) = troubled(AppFacts(app=make_app(), instances=(facts,), now="2026-01-01T00:00:00Z"))
        assert item["reason"] == "RobotOffline"
        assert "robotics.io/robot=a" in item["message"]
        assert "connectivity.grace" in item["message"]
