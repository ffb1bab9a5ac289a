"""Which nodes a component may use by its tiers and robot."""

import pytest

from robotapp_api.values.placement.component_nodes import may_be_on_robot, robot_tolerations, tier_terms
from robotapp_api.values.selector import matches_labels

AMR = {"robotics.io/robot": "amr", "robotics.io/tier": "robot"}
OTHER = {"robotics.io/robot": "agv", "robotics.io/tier": "robot"}
EDGE = {"robotics.io/tier": "edge"}
BARE: dict[str, str] = {}


@pytest.mark.parametrize(
    ("runs_on", "robot", "admitted"),
    [
        ((), "", [AMR, OTHER, EDGE, BARE]),
        ((), "amr", [AMR, EDGE, BARE]),
        (("Robot",), "amr", [AMR]),
        (("Robot",), "", [AMR, OTHER]),
        (("Edge", "Robot"), "amr", [AMR, EDGE]),
        (("Edge",), "amr", [EDGE]),
    ],
)
def test_the_own_robot_and_the_tiers_named_are_admitted_and_no_other_robot(
    runs_on: tuple[str, ...], robot: str, admitted: list[dict[str, str]]
) -> None:
    terms = tier_terms(runs_on, robot) or [[]]
    found = [
        labels
        for labels in (AMR, OTHER, EDGE, BARE)
        if any(matches_labels({"matchExpressions": term}, labels) for term in terms)
    ]
    assert found == admitted


def test_taints_of_robots_are_tolerated_where_the_component_may_be_on_one() -> None:
    assert [may_be_on_robot(tiers, "amr") for tiers in ((), ("Edge",), ("Edge", "Robot"))] == [True, False, True]
    assert not may_be_on_robot((), "")
    assert robot_tolerations("amr")[0] == {"key": "robotics.io/robot", "operator": "Equal", "value": "amr"}
    assert robot_tolerations("")[0]["operator"] == "Exists"
