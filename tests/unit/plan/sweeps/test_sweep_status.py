"""The status of a sweep while some of its instances have ended, some run, and the others wait for their turn."""

import dataclasses
from typing import Any

from tests.support.factories import component, make_app

from robotapp_api.model.names import Phase, Reason
from robotapp_claims.rules.completion.endings import Ending
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.status.components import ComponentView
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.status import render_status

TURN = "waits for its turn: 1 of 3 instances run at once (matrix.parallelism)"
RUNNING = ComponentView(
    name="sim", replicas=1, ready=True, exists=True, bound=True, rolling=False, nodes=("n",), is_job=True
)
WAITING = dataclasses.replace(
    RUNNING, ready=False, exists=False, bound=False, rolling=True, nodes=(), message=TURN, waits=True
)
STARTING = dataclasses.replace(RUNNING, ready=False, bound=False, nodes=())
COMPLETED = Ending(Reason.COMPLETED, "sim", "2026-01-01T00:00:00Z")


def status_of(*views: ComponentView | None) -> dict[str, Any]:
    """The status of a sweep with an instance for each view, completed where there is none."""
    matrix = {"parameters": [{"name": "seed", "values": [str(number) for number in range(len(views))]}]}
    app = make_app(component("sim", job={}), matrix=matrix)
    instances = tuple(
        InstanceFacts(
            instance=Instance(name),
            components=(view or dataclasses.replace(RUNNING, completed=True),),
            domain=7 if view is RUNNING else None,
            needs_domain=view in (RUNNING, STARTING),
            ending=None if view else COMPLETED,
        )
        for name, view in zip(sorted(app.sweep), views, strict=True)
    )
    return render_status(AppFacts(app=app, instances=instances, now="2026-01-01T00:00:00Z"))


def ready_of(status: dict[str, Any]) -> dict[str, Any]:
    return next(item for item in status["conditions"] if item["type"] == "Ready")


def test_a_sweep_is_as_its_instances_that_have_begun_and_shows_how_far_it_is() -> None:
    status = status_of(None, RUNNING, WAITING)
    assert status["phase"] == Phase.RUNNING
    assert ready_of(status)["status"] == "False"
    assert ready_of(status)["message"].startswith("1 of 3 instances have ended, 1 still to begin")
    assert status["instanceCounts"] == {"desired": 3, "ready": 1, "offline": 0, "completed": 1, "failed": 0}
    assert status_of(None, STARTING, WAITING)["phase"] == Phase.PLACING


def test_instances_that_wait_for_their_turn_are_in_no_trouble() -> None:
    assert status_of(None, RUNNING, WAITING).get("troubled", []) == []


def test_a_sweep_whose_instances_have_all_completed_is_completed() -> None:
    status = status_of(None, None)
    assert status["phase"] == Phase.COMPLETED
    allocated = next(item["message"] for item in status["conditions"] if item["type"] == "Allocated")
    assert allocated == "every instance has ended and has given back what it had"
