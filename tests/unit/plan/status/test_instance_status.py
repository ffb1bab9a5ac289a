"""What a RobotAppInstance tells."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import pytest
from tests.support.factories import make_app, round_trips, telemetry
from tests.support.largest import largest_status

from robotapp_api.model.instance import InstanceStatus
from robotapp_api.model.names import Condition, Phase, Reason
from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.diff.attempts import Attempt, read_attempt
from robotapp_operator.plan.spec.text import stored_bytes
from robotapp_operator.plan.spec.validate import Problem
from robotapp_operator.plan.status.components import ComponentView
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts, of_instance
from robotapp_operator.plan.status.instance_status import render_instance, same_instance_status
from robotapp_operator.plan.status.latency import EdgeView, edge_views, worst_first
from robotapp_operator.plan.status.status import MAX_STATUS_BYTES

UP = ComponentView(name="driver", replicas=1, ready=True, exists=True, bound=True, rolling=False, nodes=("edge-1",))
STARTING = dataclasses.replace(UP, ready=False)
ABSENT = dataclasses.replace(STARTING, exists=False, bound=False, nodes=())
UNCLEAR = Instance("amr-07", "", "robot amr-07 has 2 nodes: label one")
EDGE = {"kind": "Service", "topic": "/plan", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}


def instance(*components: ComponentView, **fields: Any) -> InstanceFacts:
    given = {"instance": Instance("amr-07", "n-7"), "domain": 7, "components": components or (UP,)}
    return InstanceFacts(**(given | fields))


def edges(p95_ms: float = 18) -> tuple[EdgeView, ...]:
    placed = {"operator": "edge-1", "driver": "amr"}
    table = {"edge-1": telemetry("edge-1", amr=p95_ms)}
    return worst_first(
        edge_views(make_app(edges=[EDGE]).spec.edges, placed=placed, robot_node="", round_trips=round_trips(table))
    )


def status_of(
    found: InstanceFacts,
    *,
    app: Mapping[str, Any] | None = None,
    previous: Mapping[str, object] | None = None,
    now: str = "2026-01-01T00:00:00Z",
    **facts: Any,
) -> dict[str, Any]:
    whole = AppFacts(app=make_app(**(app or {})), instances=(found, instance()), now=now, **facts)
    status = render_instance(of_instance(whole, found, previous=previous or {}))
    InstanceStatus.model_validate(status)
    return status


def conditions(status: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    return {item["type"]: (item["status"], item["reason"]) for item in status["conditions"]}


def messages(status: Mapping[str, Any]) -> dict[str, str]:
    return {item["type"]: item["message"] for item in status["conditions"]}


def test_all_is_well() -> None:
    status = status_of(instance(edges=edges(), claims=("dds.default.c.7",), devices_wanted=1, devices_held=1))
    assert list(conditions(status)) == [kind.value for kind in Condition]
    assert conditions(status)["Ready"] == ("True", "AllComponentsReady")
    del status["conditions"]
    assert status == {
        "phase": "Running",
        "summary": {"ready": "1/1", "budget": "18/30ms", "devices": "1/1", "nodes": "edge-1"},
        "domain": 7,
        "components": [{"name": "driver", "ready": True, "restarts": 0, "node": "edge-1"}],
        "edges": [
            {
                "kind": "Service",
                "topic": "/plan",
                "from": "operator",
                "to": "driver",
                "measured": True,
                "nodes": ["edge-1", "amr"],
                "budget": "30ms",
                "p95": "18ms",
                "met": True,
            }
        ],
        "claims": ["dds.default.c.7"],
    }


def test_other_instances_are_another_matter() -> None:
    failing = dataclasses.replace(STARTING, reason=Reason.CRASH_LOOP, message="exit code 1")
    assert conditions(status_of(instance(failing)))["Ready"] == ("False", "CrashLoop")
    assert conditions(status_of(instance()))["Ready"] == ("True", "AllComponentsReady")


def test_messages_do_not_repeat_whose_they_are() -> None:
    failing = dataclasses.replace(STARTING, reason=Reason.CRASH_LOOP, message="exit code 1")
    status = status_of(instance(failing))
    assert messages(status)["Ready"] == status["summary"]["message"] == "0 of 1 component is ready; driver: exit code 1"


def test_conditions_are_about_this_object_whose_spec_never_changes() -> None:
    status = status_of(instance(), app={"generation": 9})
    assert {item["observedGeneration"] for item in status["conditions"]} == {1}


def test_a_robot_whose_node_is_unclear_is_not_accepted_and_says_what_to_label() -> None:
    status = status_of(instance(ABSENT, instance=UNCLEAR, domain=None))
    assert conditions(status)["Accepted"] == ("False", "RobotNodeUnclear")
    assert conditions(status)["Ready"] == ("False", "RobotNodeUnclear")
    assert conditions(status)["Progressing"] == ("False", "RobotNodeUnclear")
    assert messages(status)["Accepted"] == status["summary"]["message"] == UNCLEAR.problem
    assert status["phase"] == Phase.PENDING


def test_what_runs_for_such_a_robot_goes_on() -> None:
    status = status_of(instance(instance=UNCLEAR))
    assert conditions(status)["Accepted"] == ("False", "RobotNodeUnclear")
    assert conditions(status)["Ready"] == ("True", "AllComponentsReady")
    assert status["phase"] == Phase.RUNNING


def test_a_refused_spec_is_refused_for_every_instance() -> None:
    problem = Problem(Reason.UNKNOWN_DISTRO, "spec.ros.distro", "humbel is unknown")
    status = status_of(instance(), problems=(problem,))
    assert conditions(status)["Accepted"] == ("False", "UnknownDistro")
    assert status["phase"] == Phase.FAILED
    assert status["components"][0]["ready"], "what still runs is shown"


@pytest.mark.parametrize(("pod", "phase"), [(UP, Phase.STOPPING), (ABSENT, Phase.SUSPENDED)])
def test_a_suspended_instance_ends_its_pods_first(pod: ComponentView, phase: Phase) -> None:
    assert status_of(instance(pod), app={"suspend": True})["phase"] == phase


def test_devices_under_another_scheduler_are_unknown() -> None:
    status = status_of(instance(devices_wanted=1), app={"schedulerName": "volcano"})
    assert conditions(status)["Allocated"] == ("Unknown", "NotOurScheduler")


def test_what_ran_is_degraded_by_its_own_history() -> None:
    before = status_of(instance())
    assert status_of(instance(STARTING), previous=before)["phase"] == Phase.DEGRADED
    assert status_of(instance(STARTING))["phase"] == Phase.PLACING


def test_equal_facts_give_an_equal_status_whatever_the_time() -> None:
    first = status_of(instance(STARTING, edges=edges()))
    again = status_of(instance(STARTING, edges=edges()), previous=first, now="2030-01-01T00:00:00Z")
    assert again == first
    assert same_instance_status(again, first | {"moves": [{"component": "driver"}]})


def test_a_field_that_is_gone_is_a_difference() -> None:
    shown = status_of(instance(edges=edges()))
    assert not same_instance_status(status_of(instance(), previous=shown), shown)


def test_worst_components_come_first() -> None:
    failing = dataclasses.replace(STARTING, name="z", reason=Reason.CRASH_LOOP)
    starting = dataclasses.replace(STARTING, name="y")
    status = status_of(instance(UP, starting, failing))
    assert [item["name"] for item in status["components"]] == ["z", "y", "driver"]


@pytest.mark.parametrize("text", ["x", "<", "語", "\x01", '"', "😀"])
def test_the_largest_instance_fits_whatever_its_messages_say(text: str) -> None:
    status = largest_status(text)
    InstanceStatus.model_validate(status)
    assert stored_bytes(status) <= MAX_STATUS_BYTES
    assert len(status["components"]) == 64
    assert len(status.get("edges", ())) + status["edgesOmitted"] == 256


def test_edges_of_an_ordinary_size_are_all_shown_up_to_64() -> None:
    listed = [EDGE | {"topic": f"/t{number}"} for number in range(100)]
    app = make_app(edges=listed)
    views = worst_first(
        edge_views(app.spec.edges, placed={"operator": "a", "driver": "b"}, robot_node="", round_trips=RoundTrips())
    )
    status = status_of(instance(edges=views))
    assert len(status["edges"]) == 64
    assert status["edgesOmitted"] == 36


def test_the_record_of_attempts_is_kept_and_an_instance_that_never_started_again_has_none() -> None:
    attempt = Attempt(3, 1, "hash", "2026-01-01T00:00:00Z", "restarted 1 of 2 times: job save failed")
    status = status_of(instance(attempt=attempt))
    assert read_attempt(status) == attempt
    assert same_instance_status(status, status)
    assert not same_instance_status(status, {**status, "restarts": {"count": 0, "attempt": 3}})
    assert "restarts" not in status_of(instance())
