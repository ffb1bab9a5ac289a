"""Every CEL rule on the real API server: the same cases as in the unit tests, with the messages users read."""

from collections.abc import Iterator

import pytest
from tests.support import crds
from tests.support.apiobjects import Object, app, component, edge
from tests.support.wrong_input.rule_cases import CASES, RuleCase

from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.live

ON_CREATE = [
    pytest.param(case, id=f"{kind}: {case}") for kind, cases in CASES.items() for case in cases if not case.before
]
ON_UPDATE = [pytest.param(case, id=f"{kind}: {case}") for kind, cases in CASES.items() for case in cases if case.before]
DRY = "?dryRun=All&fieldValidation=Strict"


@pytest.fixture
def stored(control_plane: ControlPlane, case: RuleCase) -> Iterator[str]:
    """resourceVersion of the object as it was before the update."""
    assert case.before
    before = own(case.before)
    created = control_plane.api.create(crds.collection(before["kind"]), before)
    yield created["metadata"]["resourceVersion"]
    control_plane.api.delete(crds.address(before))


def own(obj: Object) -> Object:
    """`obj` under a name of this module's, where the chart's default pool has its own."""
    if obj["metadata"]["name"] != "default":
        return obj
    return obj | {"metadata": obj["metadata"] | {"name": "rules"}}


@pytest.mark.parametrize("case", ON_CREATE)
def test_a_rule_decides_on_creation(control_plane: ControlPlane, case: RuleCase) -> None:
    path = crds.collection(case.good["kind"]) + DRY
    control_plane.api.create(path, own(case.good))
    with pytest.raises(ApiStatusError) as refused:
        control_plane.api.create(path, own(case.bad))
    assert refused.value.status == 422
    assert case.says in refused.value.message


@pytest.mark.parametrize("case", ON_UPDATE)
def test_a_rule_decides_on_changes(control_plane: ControlPlane, case: RuleCase, stored: str) -> None:
    good, bad = (
        own(obj) | {"metadata": own(obj)["metadata"] | {"resourceVersion": stored}} for obj in (case.good, case.bad)
    )
    path = crds.address(good) + ("/status" if "status" in good else "") + DRY
    control_plane.api.request("PUT", path, good)
    with pytest.raises(ApiStatusError) as refused:
        control_plane.api.request("PUT", path, bad)
    assert case.says in refused.value.message


def test_the_largest_app_stays_within_the_servers_cost_budget(control_plane: ControlPlane) -> None:
    names = [f"component-{number:02}" for number in range(64)]
    mates = {name: names[(index + 1) % 64 :][:8] for index, name in enumerate(names)}
    largest = app(
        components=[component(name, colocateWith=mates[name], sharedData={"with": names[:16]}) for name in names],
        edges=[
            edge(names[number % 64], names[(number + 1) % 64], topic=f"/topic_{number}", latency={"budget": "30ms"})
            for number in range(256)
        ],
    )
    control_plane.api.create(crds.collection("RobotApp") + DRY, largest)
