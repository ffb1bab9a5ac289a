"""The status of a sweep while some of its instances have ended, some run, and the others wait for their turn."""

import dataclasses
from typing import Any

from tests.support.factories import component, make_app

from robotapp_api.model.app.status import Summary
from robotapp_api.model.names import Phase, Reason
from robotapp_api.values.sweeps.matrix import MOST_INSTANCES
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


def status_of(*views: ComponentView | Ending | None) -> dict[str, Any]:
    """The status of a sweep with an instance for each view, ended where there is an ending, completed where there is nothing."""
    matrix = {"parameters": [{"name": "seed", "values": [str(number) for number in range(len(views))]}]}
    app = make_app(component("sim", job={}), matrix=matrix)
    instances = tuple(
        InstanceFacts(
            instance=Instance(name),
            components=(view if isinstance(view, ComponentView) else dataclasses.replace(RUNNING, completed=True),),
            domain=7 if view is RUNNING else None,
            needs_domain=view in (RUNNING, STARTING),
            ending=None if isinstance(view, ComponentView) else view or COMPLETED,
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


def test_the_table_of_kubectl_has_how_many_runs_are_done() -> None:
    assert status_of(None, RUNNING, WAITING)["summary"]["ready"] == "1/3 done"
    assert status_of(None, None)["summary"]["ready"] == "2/2 done"
    failed = Ending(Reason.JOB_FAILED, "sim", "2026-01-01T00:00:00Z")
    status = status_of(None, failed, RUNNING)
    assert status["summary"]["ready"] == "1/3 done, 1 failed"
    assert ready_of(status)["message"].startswith("2 of 3 instances have ended (1 failed)")


def test_the_longest_figures_of_a_sweep_fit_into_its_column() -> None:
    field = Summary.model_fields["ready"]
    longest = next(item.max_length for item in field.metadata if getattr(item, "max_length", None))
    assert len(f"{MOST_INSTANCES}/{MOST_INSTANCES} done, {MOST_INSTANCES} failed") <= longest


def test_instances_that_wait_for_their_turn_are_in_no_trouble() -> None:
    assert status_of(None, RUNNING, WAITING).get("troubled", []) == []


def test_only_instances_that_have_begun_are_to_be_placed() -> None:
    unscheduled = dataclasses.replace(STARTING, reason=Reason.UNSCHEDULABLE, message="0/5 nodes fit")
    status = status_of(unscheduled, WAITING, WAITING)
    placed = next(item for item in status["conditions"] if item["type"] == "Placed")
    assert (placed["reason"], placed["message"].split(";")[0]) == (Reason.UNSCHEDULABLE, "0 of 1 placed")
    placed = next(item for item in status_of(None, RUNNING, WAITING)["conditions"] if item["type"] == "Placed")
    assert (placed["status"], placed["message"]) == ("True", "1 of 1 component on n")


def test_a_sweep_whose_instances_have_all_completed_is_completed() -> None:
    status = status_of(None, None)
    assert status["phase"] == Phase.COMPLETED
    allocated = next(item["message"] for item in status["conditions"] if item["type"] == "Allocated")
    assert allocated == "every instance has ended and has given back what it had"
