"""Which taints keep the pods of a component away."""

from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_operator.plan.render.node_affinity import tolerates_all
from robotapp_operator.plan.spec.desired import desired_of
from robotapp_operator.plan.spec.objects import Taint

ONLY_GPU = Taint(key="gpu", value="yes", effect="NoSchedule")


@pytest.mark.parametrize(
    ("written", "taints", "let_in"),
    [
        ([], [], True),
        ([], [ONLY_GPU], False),
        ([], [Taint(key="soft", effect="PreferNoSchedule")], True),
        ([{"key": "gpu", "value": "yes"}], [ONLY_GPU], True),
        ([{"key": "gpu", "value": "no"}], [ONLY_GPU], False),
        ([{"key": "gpu", "operator": "Exists", "effect": "NoExecute"}], [ONLY_GPU], False),
        ([{"operator": "Exists"}], [ONLY_GPU, Taint(key="x", effect="NoExecute")], True),
        (
            [{"key": "gpu", "operator": "Exists", "tolerationSeconds": 5}],
            [ONLY_GPU, Taint("x", "", "NoExecute")],
            False,
        ),
        ([{"key": None, "value": 7}], [ONLY_GPU], False),
    ],
)
def test_every_taint_that_closes_a_node_must_be_tolerated(
    written: list[dict[str, Any]], taints: list[Taint], let_in: bool
) -> None:
    app = make_app(component(runsOn=["Edge"], template={"spec": {"tolerations": written}}))
    assert tolerates_all(app.spec.components[0], desired_of(app, ""), taints) is let_in
