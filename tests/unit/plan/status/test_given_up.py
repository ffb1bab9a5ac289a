"""`Placed` with reason FallbackUsed: what was given up, each thing once and as long as it is so."""

import dataclasses
import math

from tests.unit.plan.status.test_status import UP, condition, instance, message, status_of

from robotapp_api.model.names import ROBOT_END, Condition, Reason
from robotapp_api.values.placement.given_up import GivenUp, GivenUpEdge
from robotapp_operator.plan.status.components import ComponentView

HERE = GivenUp((GivenUpEdge("/image", "detector", 30_000, 42_000.0, "estimated", ("edge-1", "edge-2")),))
THERE = GivenUp((GivenUpEdge("/image", "camera", 30_000, 42_000.0, "estimated", ("edge-2", "edge-1")),))


def part(name: str, node: str, *given: GivenUp) -> ComponentView:
    return dataclasses.replace(UP, name=name, nodes=(node,), given_up=given)


def test_an_edge_is_named_once_with_its_numbers_though_both_ends_tell_of_it() -> None:
    status = status_of(instance(part("camera", "edge-1", HERE), part("detector", "edge-2", THERE)))
    assert condition(status, Condition.PLACED) == ("True", Reason.FALLBACK_USED)
    assert message(status, Condition.PLACED) == (
        "2 of 2 components on edge-1, edge-2; given up: "
        "/image between camera and detector takes 42ms (estimated, edge-1 to edge-2) instead of 30ms"
    )


def test_an_edge_whose_other_end_has_moved_is_history() -> None:
    status = status_of(instance(part("camera", "edge-1", HERE), part("detector", "edge-3")))
    assert condition(status, Condition.PLACED) == ("True", Reason.PLACED)


def test_a_later_tier_and_a_robot_out_of_reach_are_named_with_their_robot() -> None:
    lost = GivenUp((GivenUpEdge("/scan", ROBOT_END, 30_000, math.inf, "measured", ("edge-1", "amr-2")),))
    status = status_of(
        instance(part("planner", "amr-1", GivenUp((), "Robot", ("Edge", "Cloud"))), robot="amr-1"),
        instance(part("planner", "edge-1", lost), robot="amr-2"),
    )
    assert message(status, Condition.PLACED).endswith(
        "given up: amr-1: planner runs on tier Robot instead of Edge, Cloud, "
        "amr-2: /scan between planner and @robot is unreachable (measured, edge-1 to amr-2) instead of 30ms"
    )


def test_of_many_things_some_are_named() -> None:
    fleet = [instance(part("planner", f"amr-{i}", GivenUp((), "Robot", ("Edge",))), robot=f"amr-{i}") for i in range(9)]
    assert message(status_of(*fleet), Condition.PLACED).endswith(" and 5 more")


def test_an_app_that_is_not_placed_has_used_no_fallback_yet() -> None:
    waits = dataclasses.replace(UP, name="camera", bound=False, ready=False, nodes=())
    status = status_of(instance(part("planner", "amr-1", GivenUp((), "Robot", ("Edge",))), waits))
    assert condition(status, Condition.PLACED) == ("Unknown", Reason.WAITING_FOR_PODS)
