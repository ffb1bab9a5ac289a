"""The order of deployments, and the RobotApp that each arm deploys."""

from collections import Counter
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from campaigns.teleop import apps
from campaigns.teleop.design import ARMS, CLOUD, FAR, NEAR, ROUNDS, SEED, Arm, Condition, Turn, plan_turns
from robotapp_cli.lint.findings import Severity
from robotapp_cli.lint.linter import lint

SEEDS = st.integers(0, 2**32)


def turn(arm: Arm, ros: int = 2) -> Turn:
    return Turn(1, 1, Condition(ros, ballast=False, worse_link=False), arm)


@given(SEEDS)
def test_every_round_has_each_condition_in_its_proportion(seed: int) -> None:
    turns = plan_turns(seed, rounds=2)
    for part in (turns[:48], turns[48:]):
        conditions = Counter(one.condition for one in part[:: len(ARMS)])
        assert sum(conditions.values()) == 16
        assert sum(count for condition, count in conditions.items() if condition.ballast) == 8
        assert sum(count for condition, count in conditions.items() if condition.worse_link) == 4
        assert sum(count for condition, count in conditions.items() if condition.ros == 1) == 8
        assert len(conditions) == 8


@given(SEEDS)
def test_each_block_has_one_condition_and_every_arm_once(seed: int) -> None:
    turns = plan_turns(seed, rounds=1)
    assert [one.number for one in turns] == list(range(1, 49))
    for begin in range(0, 48, 3):
        block = turns[begin : begin + 3]
        assert {one.arm for one in block} == set(ARMS)
        assert len({(one.block, one.condition) for one in block}) == 1


def test_the_registered_run_has_32_deployments_per_arm_and_generation() -> None:
    counts = Counter((one.arm, one.condition.ros) for one in plan_turns(SEED, ROUNDS))
    assert set(counts.values()) == {32}
    assert len(counts) == 6


def test_a_seed_gives_the_same_order_each_time_and_another_seed_another_one() -> None:
    assert plan_turns(5) == plan_turns(5)
    assert plan_turns(5) != plan_turns(6)


def test_no_arm_is_always_the_first_of_its_block() -> None:
    assert {one.arm for one in plan_turns(SEED)[::3]} == set(ARMS)


@pytest.mark.parametrize(
    ("node", "kept", "kept_with_worse_link"), [(NEAR, True, False), (FAR, True, True), (CLOUD, False, False)]
)
def test_the_budget_is_kept_where_the_round_trip_that_is_set_is_within_it(
    node: str, kept: bool, kept_with_worse_link: bool
) -> None:
    assert Condition(2, ballast=True, worse_link=False).keeps_budget(node) == kept
    assert Condition(2, ballast=False, worse_link=True).keeps_budget(node) == kept_with_worse_link


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("arm", ARMS)
def test_the_app_of_every_arm_is_clean(arm: Arm, ros: int) -> None:
    report = lint(yaml.safe_dump(apps.make_app(turn(arm, ros))).encode())
    assert [one for one in report.findings if one.severity == Severity.ERROR] == []


def specs(arm: Arm) -> tuple[dict[str, Any], dict[str, Any]]:
    """Returns the spec of an arm without its operator side, and the operator side."""
    spec = apps.make_app(turn(arm))["spec"]
    operator = next(one for one in spec["components"] if one["name"] == apps.OPERATOR)
    spec["components"].remove(operator)
    return spec, operator


def test_arms_differ_in_scheduler_and_affinity_alone() -> None:
    (theirs, plain), (same, pinned), (ours, own) = (specs(arm) for arm in (Arm.KUBE_SCHEDULER, Arm.AFFINITY, Arm.OURS))
    assert theirs == same
    assert (theirs.pop("schedulerName"), ours.pop("schedulerName")) == ("default-scheduler", "ros-aware-scheduler")
    assert theirs == ours
    assert plain == own
    assert (plain.pop("runsOn"), pinned.pop("runsOn")) == (["Cloud", "Edge"], ["Edge"])
    assert pinned["template"]["spec"].pop("nodeSelector") == {"topology.kubernetes.io/zone": "hall-1"}
    assert pinned == plain
