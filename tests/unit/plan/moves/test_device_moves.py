"""Whether a pod moves because a device of it is lost."""

from collections.abc import Collection
from datetime import UTC, datetime

from tests.support.factories import component, make_app

from robotapp_operator.plan.moves.device_moves import move_for_device
from robotapp_operator.plan.moves.mass_loss import Losses
from robotapp_operator.plan.moves.move_record import NO_MOVES, MoveRecord
from robotapp_operator.plan.moves.rescheduling import Move, Running, Stays
from robotapp_operator.plan.status.device_loss import LostDevice

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
LOST = LostDevice("planner", "dev.far.cam", "planner-uid", "usb-cam", "far")


def decide(
    *,
    elsewhere: str = "near",
    record: MoveRecord | None = NO_MOVES,
    pod: str = "planner-uid",
    others: Collection[str] = (),
    **planner: object,
) -> Move | Stays | None:
    camera = {"name": "cam", "type": "usb", "onLoss": "Reschedule"}
    app = make_app(component("planner", devices=[camera], **planner))
    running = {"planner": Running(component=app.spec.components[0], pod=pod, node="far", record=record)}
    held = {"far": frozenset({pod, *others})}
    losses = Losses(holding=held, lost=held if others else {"far": frozenset({pod})})
    return move_for_device(app, [LOST], running=running, elsewhere=lambda _: elsewhere, losses=lambda: losses, now=NOW)


def test_the_pod_that_lost_its_device_moves_to_where_another_is_free() -> None:
    assert decide() == Move("planner", "planner-uid", "far", "near", "device usb-cam on far is lost")
    assert decide(elsewhere="") == Stays("planner", "no other node has such a device that is free")
    assert decide(pod="its successor") is None


def test_of_several_replicas_none_moves_also_while_only_one_of_them_runs() -> None:
    assert decide(replicas=2) is None


def test_a_record_that_cannot_be_read_and_a_move_a_moment_ago_keep_the_pod() -> None:
    assert "cannot be read" in str(decide(record=None))
    assert "placement.reschedule.cooldown" in str(decide(record=MoveRecord(times=(NOW,), pod="another")))


def test_a_component_that_is_tied_to_its_robot_stays_and_its_user_is_told_why() -> None:
    assert decide(runsOn=["Robot"]) == Stays("planner", "it stays on its robot: runsOn is [Robot]")
    assert isinstance(decide(runsOn=["Robot", "Edge"]), Move)


def test_a_pod_stays_when_others_of_its_node_lost_a_device_at_once() -> None:
    assert "a mistake of the agent is likelier" in str(decide(others=["another"]))
