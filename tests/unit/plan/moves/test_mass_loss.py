"""When so many devices are lost at once that nobody is moved or restarted for it."""

from collections.abc import Sequence

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.moves.mass_loss import Losses, losses_of

Held = tuple[str, str, bool]
"""Pod, node, and whether the device is lost."""


def claim(pod: str, node: str, *, phase: str = "Reserved") -> Claim:
    holder = {"apiVersion": "v", "kind": "RobotApp", "namespace": "n", "name": "a", "uid": "u"}
    spec = {"device": {"node": node, "type": "usb", "id": pod}, "holder": holder}
    return msgspec.convert(
        {"metadata": {"name": f"dev.{node}.{pod}"}, "spec": spec, "status": {"pod": pod, "phase": phase}}, Claim
    )


def losses(held: Sequence[Held]) -> Losses:
    return losses_of((claim(pod, node), lost) for pod, node, lost in held)


def one_node(count: int, lost: int) -> list[Held]:
    return [(f"p{number}", "edge-1", number < lost) for number in range(count)]


@pytest.mark.parametrize(
    ("count", "lost", "moves", "restarts"),
    [
        (1, 1, True, True),
        (2, 1, True, True),
        (2, 2, False, True),
        (3, 3, False, True),
        (4, 3, True, True),
        (4, 4, False, False),
        (10, 4, False, False),
        (40, 4, True, True),
        (40, 5, False, False),
    ],
)
def test_of_one_node_as_many_pods_move_as_robots_may_be_without_a_node(
    count: int, lost: int, *, moves: bool, restarts: bool
) -> None:
    found = losses(one_node(count, lost))
    assert (found.why_no_move("edge-1") == "") is moves
    assert found.too_many_to_restart("edge-1") is not restarts


def test_an_agent_that_reports_all_devices_of_its_node_gone_holds_nobody_back_elsewhere() -> None:
    others = [(f"q{number}", f"edge-{number + 2}", number == 0) for number in range(10)]
    found = losses([*one_node(20, 20), *others])
    assert "pods on its node lost devices at once" in found.why_no_move("edge-1")
    assert found.why_no_move("edge-2") == ""
    assert not found.too_many_to_restart("edge-2")


def test_agents_of_many_nodes_that_report_one_loss_each_move_and_restart_nothing() -> None:
    found = losses([(f"p{number}", f"edge-{number}", number < 5) for number in range(20)])
    assert "so many nodes lost devices at once" in found.why_no_move("edge-0")
    assert found.too_many_to_restart("edge-0")


def test_a_claim_without_a_pod_counts_on_neither_side() -> None:
    found = losses_of(
        [(claim("p", "edge-1"), True), (claim("q", "edge-1", phase="Draining"), True), (claim("", "edge-1"), True)]
    )
    assert found == losses([("p", "edge-1", True)])


@given(st.lists(st.tuples(st.sampled_from("pqrstuvwxyz"), st.sampled_from("abcdef"), st.booleans()), max_size=40))
def test_what_is_moved_at_once_is_few_of_a_node_and_few_nodes_of_the_cluster(held: list[Held]) -> None:
    found = losses(held)
    free = {node: found.lost[node] for node in found.lost if not found.why_no_move(node)}
    assert len(free) <= max(3, len(found.holding) / 10)
    for node, pods in free.items():
        assert len(pods) <= max(3, len(found.holding[node]) / 10)
        assert len(pods) < max(2, len(found.holding[node]))
        assert not found.too_many_to_restart(node), "what may move may restart"
