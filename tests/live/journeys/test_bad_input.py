"""Bad input is refused by name, hurts nobody else, and no process falls over it."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from tests.live.journeys.conftest import Pools
from tests.support.wrong_input.malformed import Malformed, malformed_apps
from tests.support.wrong_input.malformed_annotations import Wrong, malformed_annotations, pod

from campaigns.operating.apply import misfits
from campaigns.rigs.appwatch import condition
from campaigns.rigs.journeys import start_one
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.names import PodReason
from robotapp_api.schema.crd import schema_of
from robotapp_testbed import ApiStatusError, wait_until

pytestmark = pytest.mark.live

Object = dict[str, Any]
MALFORMED = 90
TRIES = 3
BATCH = 15
READY_S = 2.0
"""The promise, which `scripts/bench apply --only bad_input` measures; on a busy machine an app alone may need as long."""
ALLOWED = (
    "must be of type",
    "supported values",
    "may not be more than",
    "must have at most",
    "should be",
    "should match",
)
"""How the API server says what it would take."""


@pytest.fixture(autouse=True)
def steady(world: SimulatedSite) -> Iterator[None]:
    """Operator and scheduler are the same processes afterwards and logged no stack."""
    before = (world.operator.pid, world.scheduler.pid)
    yield
    assert world.operator.running
    assert world.scheduler.running
    assert (world.operator.pid, world.scheduler.pid) == before
    assert "Traceback" not in world.operator.log_text()
    assert "Traceback" not in world.scheduler.log_text()


def test_ninety_malformed_apps_are_refused_by_field_and_healthy_ones_start_in_between(
    world: SimulatedSite, pools: Pools
) -> None:
    cases = malformed_apps(schema_of(RobotApp))
    chosen = [cases[index * len(cases) // MALFORMED] for index in range(MALFORMED)]
    promised_s = _promised_s(world, pools)
    unclear: list[str] = []
    for first in range(0, MALFORMED, BATCH):
        batch = chosen[first : first + BATCH]

        def send(_: int, batch: Sequence[Malformed] = batch) -> None:
            unclear.extend(_refused(world, batch))

        assert _starts(world, f"healthy-{first:02}", pools, within_s=promised_s, beside=send)
    assert unclear == []


def test_ten_apps_that_cannot_work_say_so_in_a_condition_and_healthy_ones_start_in_between(
    world: SimulatedSite, pools: Pools
) -> None:
    promised_s = _promised_s(world, pools)
    cases = misfits()
    assert len(cases) == 100 - MALFORMED

    def send(attempt: int) -> None:
        world.create_all([_named(case.app, attempt) for case in cases])

    assert _starts(world, "healthy", pools, within_s=promised_s, beside=send)
    for case in cases:
        name = case.app["metadata"]["name"]
        world.watch.until(
            lambda apps, name=name, kind=case.kind: condition(apps[name], kind).get("status") == "False",
            within_s=60,
            what=f"{name}: {case.kind}=False",
        )
        said = condition(world.watch.apps[name], case.kind)
        for word in (case.field, *case.words):
            assert word in said["message"], name
        assert condition(world.watch.apps[name], "Ready")["status"] == "False"


def test_malformed_annotations_keep_a_pod_pending_and_name_key_field_value_and_what_is_allowed(
    world: SimulatedSite, pools: Pools
) -> None:
    promised_s = _promised_s(world, pools)
    cases = {f"wrong-{index:02}": wrong for index, wrong in enumerate(malformed_annotations())}
    path = f"/api/v1/namespaces/{world.namespace}/pods"
    sent: list[str] = []

    def send(attempt: int) -> None:
        pods = [_named(pod(*item), attempt) for item in cases.items()]
        sent.extend(each["metadata"]["name"] for each in pods)
        world.cp.api.each(lambda each: world.cp.api.create(path, each), pods)

    try:
        assert _starts(world, "healthy", pools, within_s=promised_s, beside=send)
        assert wait_until(lambda: _all_judged(world, cases), timeout_s=60, poll_s=0.2)
        said = {each["metadata"]["name"]: each for each in world.pods() if each["metadata"]["name"] in cases}
        assert all(not each["spec"].get("nodeName") for each in said.values())
        for name, wrong in cases.items():
            verdict = _verdict(said[name])
            assert verdict["reason"] == PodReason.INVALID_ANNOTATION, str(wrong)
            for part in (wrong.key, wrong.field, wrong.shown, wrong.allowed):
                assert part in verdict["message"], str(wrong)
    finally:
        world.cp.api.each(lambda name: world.cp.api.delete(f"{path}/{name}"), sent)


def _promised_s(world: SimulatedSite, pools: Pools) -> float:
    """What a healthy app may take among bad ones, as this machine is now."""
    return max(READY_S, 2 * start_one(world, "undisturbed", pools.twelve))


def _starts(world: SimulatedSite, name: str, pools: Pools, *, within_s: float, beside: Callable[[int], None]) -> bool:
    """Whether a healthy app gets Ready in time right after bad ones, which `beside` sends anew at each attempt.

    Bad apps would delay every one, other programs delay one: so one of a few counts.
    """
    for attempt in range(TRIES):
        beside(attempt)
        again = f"-again-{attempt}" if attempt else ""
        if start_one(world, name + again, pools.spare if attempt else pools.twelve) < within_s:
            return True
    return False


def _named(obj: Object, attempt: int) -> Object:
    """The same object under a name of its own for each attempt."""
    again = f"-again-{attempt}" if attempt else ""
    return obj | {"metadata": obj["metadata"] | {"name": obj["metadata"]["name"] + again}}


def _refused(world: SimulatedSite, cases: Sequence[Malformed]) -> list[str]:
    """Of these cases, those that were taken, or refused without naming the field and then what is allowed."""
    unclear = []
    for case in cases:
        try:
            world.create(case.obj)
            unclear.append(f"{case.field} was taken")
        except ApiStatusError as refused:
            after = str(refused).partition(case.field)[2]
            if refused.status not in (400, 422) or not any(words in after for words in ALLOWED):
                unclear.append(f"{case.field}: {refused}")
    return unclear


def _verdict(found: dict) -> dict:
    conditions = found["status"].get("conditions") or []
    return next((each for each in conditions if each["type"] == "PodScheduled" and each["status"] == "False"), {})


def _all_judged(world: SimulatedSite, cases: dict[str, Wrong]) -> bool:
    return all(_verdict(each) for each in world.pods() if each["metadata"]["name"] in cases)
