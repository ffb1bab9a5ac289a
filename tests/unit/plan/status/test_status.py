"""Phase, conditions, counts and the table line of an app."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import pytest
from tests.support.factories import component, make_app, round_trips, telemetry

from robotapp_api.model.app.status import RobotAppStatus
from robotapp_api.model.names import Condition, EventReason, Phase, Reason
from robotapp_api.values.approval import read_approval
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.diff.newer import Held
from robotapp_operator.plan.spec.text import count_of, stored_bytes
from robotapp_operator.plan.spec.validate import Problem
from robotapp_operator.plan.status.components import ComponentView, HelperPart, HelperView
from robotapp_operator.plan.status.events import events_between
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeView, edge_views, worst_first
from robotapp_operator.plan.status.pace import is_progress
from robotapp_operator.plan.status.status import MAX_STATUS_BYTES, domains_text, ranges, render_status

UP = ComponentView(name="driver", replicas=1, ready=True, exists=True, bound=True, rolling=False, nodes=("edge-1",))
STARTING = dataclasses.replace(UP, ready=False)
WAITING = dataclasses.replace(UP, ready=False, bound=False, nodes=())
EDGE = {"topic": "/cmd_vel", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}


def instance(*components: ComponentView, robot: str = "", **fields: Any) -> InstanceFacts:
    given = {"domain": 7, "components": components or (UP,), **fields}
    return InstanceFacts(instance=Instance(robot, f"n-{robot}" if robot else ""), **given)


def status_of(*instances: InstanceFacts, app: Mapping[str, Any] | None = None, **facts: Any) -> dict[str, Any]:
    whole = AppFacts(app=make_app(**(app or {})), instances=instances, **({"now": "2026-01-01T00:00:00Z"} | facts))
    status = render_status(whole)
    RobotAppStatus.model_validate(status)  # within every bound of the API
    return status


def condition(status: Mapping[str, Any], kind: Condition) -> tuple[str, str]:
    (found,) = [item for item in status["conditions"] if item["type"] == kind.value]
    return found["status"], found["reason"]


def message(status: Mapping[str, Any], kind: Condition) -> str:
    (found,) = [item["message"] for item in status["conditions"] if item["type"] == kind.value]
    return str(found)


def edges(*, p95_ms: float | None = 18, budget: str = "30ms", lost: bool = False) -> tuple[EdgeView, ...]:
    app = make_app(edges=[EDGE | {"latency": {"budget": budget}}])
    table = {"edge-1": telemetry("edge-1", amr=p95_ms)} if p95_ms is not None or lost else {}
    placed = {"operator": "edge-1", "driver": "amr"}
    return worst_first(edge_views(app.spec.edges, placed=placed, robot_node="", round_trips=round_trips(table)))


def test_all_is_well() -> None:
    status = status_of(instance(edges=edges()))
    assert status["phase"] == Phase.RUNNING
    assert {item["type"]: (item["status"], item["reason"]) for item in status["conditions"]} == {
        "Ready": ("True", "AllComponentsReady"),
        "Accepted": ("True", "Accepted"),
        "Allocated": ("True", "Allocated"),
        "Placed": ("True", "Placed"),
        "BudgetMet": ("True", "WithinBudget"),
        "Progressing": ("False", "UpToDate"),
        "Stalled": ("False", "NotStalled"),
    }
    assert status["instanceCounts"] == {"desired": 1, "ready": 1, "offline": 0, "completed": 0, "failed": 0}
    assert status["troubled"] == []
    assert status["summary"] == {
        "ready": "1/1",
        "robots": "-",
        "domain": "7",
        "budget": "18/30ms",
        "nodes": "edge-1",
    }


def test_every_condition_carries_the_observed_generation() -> None:
    status = status_of(instance(), app={"generation": 4})
    assert status["observedGeneration"] == 4
    assert {item["observedGeneration"] for item in status["conditions"]} == {4}


def test_transition_times_move_only_with_the_status() -> None:
    first = status_of(instance(STARTING), now="2026-01-01T00:00:00Z")
    second = status_of(instance(UP), now="2026-01-02T00:00:00Z", previous=first)
    times = {item["type"]: item["lastTransitionTime"] for item in second["conditions"]}
    assert times["Ready"] == "2026-01-02T00:00:00Z"
    assert times["Accepted"] == "2026-01-01T00:00:00Z"


def test_equal_facts_give_an_equal_status_whatever_the_time() -> None:
    first = status_of(instance(STARTING, edges=edges()))
    again = status_of(instance(STARTING, edges=edges()), now="2027-01-01T00:00:00Z", previous=first)
    assert again == first


def test_a_refused_spec_fails_with_every_problem_named() -> None:
    problems = tuple(Problem(Reason.INVALID_SPEC, f"spec.f{number}", "wrong") for number in range(5))
    status = status_of(problems=problems)
    assert status["phase"] == Phase.FAILED
    assert condition(status, Condition.ACCEPTED) == ("False", Reason.INVALID_SPEC)
    assert "spec.f0: wrong; spec.f1: wrong; spec.f2: wrong (and 2 more)" in message(status, Condition.ACCEPTED)
    assert condition(status, Condition.STALLED) == ("True", Reason.INVALID_SPEC)
    assert condition(status, Condition.ALLOCATED) == ("Unknown", Reason.INVALID_SPEC)
    assert status["summary"]["message"] == "spec.f0: wrong"


def test_an_instance_without_a_domain_says_why_and_what_to_do() -> None:
    refusal = (Reason.DOMAIN_EXHAUSTED, "119 of 119 ids are claimed: delete an app")
    absent = dataclasses.replace(WAITING, exists=False)
    status = status_of(instance(absent, domain=None, refusal=refusal, robot="amr-07"))
    assert status["phase"] == Phase.PENDING
    assert condition(status, Condition.ALLOCATED) == ("False", Reason.DOMAIN_EXHAUSTED)
    assert condition(status, Condition.READY) == ("False", Reason.DOMAIN_EXHAUSTED)
    assert message(status, Condition.READY) == "amr-07: 119 of 119 ids are claimed: delete an app"


def test_a_domain_not_yet_asked_for_is_unknown_not_refused() -> None:
    assert condition(status_of(instance(WAITING, domain=None)), Condition.ALLOCATED) == ("Unknown", Reason.PENDING)


def test_missing_devices_are_counted() -> None:
    status = status_of(instance(WAITING, devices_wanted=2, devices_held=1))
    assert condition(status, Condition.ALLOCATED) == ("False", Reason.WAITING_FOR_DEVICES)
    assert status["summary"]["devices"] == "1/2"


def test_a_busy_device_is_the_reason_in_the_table_too() -> None:
    stuck = dataclasses.replace(WAITING, reason=Reason.UNSCHEDULABLE, message="0/5 nodes are available")
    status = status_of(instance(stuck, devices_wanted=1, busy="device can-can0 is held by team/holder"))
    assert condition(status, Condition.READY) == ("False", Reason.DEVICE_BUSY)
    assert "team/holder" in status["summary"]["message"]


def test_devices_that_nobody_claims_are_no_reason_to_wait_and_are_named() -> None:
    gpu, tap = {"name": "gpu", "type": "gpu"}, {"name": "tap", "type": "can", "sharing": "Namespace"}
    app = make_app(component(devices=[gpu, tap]))
    status = render_status(AppFacts(app=app, instances=(instance(domain=7),), now="2026-01-01T00:00:00Z"))
    said = next(item for item in status["conditions"] if item["type"] == Condition.ALLOCATED)
    assert (said["status"], said["reason"]) == ("True", Reason.ALLOCATED)
    assert "devices without a claim: 1 handed out by a device plugin (gpu), 1 shared" in said["message"]


def test_an_app_without_a_domain_rolls_nothing_out() -> None:
    status = status_of(instance(WAITING, domain=None, refusal=(Reason.DOMAIN_EXHAUSTED, "4 of 4 ids are claimed")))
    assert condition(status, Condition.PROGRESSING) == ("False", Reason.DOMAIN_EXHAUSTED)
    assert "1 of 1 instance waits" in message(status, Condition.PROGRESSING)


def test_another_scheduler_claims_no_devices() -> None:
    status = status_of(instance(devices_wanted=1), app={"schedulerName": "default-scheduler"})
    assert condition(status, Condition.ALLOCATED) == ("Unknown", Reason.NOT_OUR_SCHEDULER)
    assert "leave spec.schedulerName out" in message(status, Condition.ALLOCATED)


def test_where_another_scheduler_is_the_operators_setting_ours_is_to_be_written() -> None:
    app = dataclasses.replace(make_app(), default_scheduler="volcano")
    status = render_status(AppFacts(app=app, instances=(instance(devices_wanted=1),), now="2026-01-01T00:00:00Z"))
    assert "write spec.schedulerName: ros-aware-scheduler" in message(status, Condition.ALLOCATED)


def test_reserved_devices_that_no_node_hands_over_are_said_to_be_so() -> None:
    status = status_of(instance(UP, devices_wanted=2, devices_held=2))
    assert condition(status, Condition.ALLOCATED) == ("True", Reason.ALLOCATED)
    text = "domain 7; 2 of 2 devices reserved, but not handed over: no driver there gives devices to containers"
    assert message(status, Condition.ALLOCATED) == text


def test_a_suspended_app_keeps_its_domain_and_waits_for_no_device() -> None:
    idle = dataclasses.replace(WAITING, replicas=0)
    status = status_of(instance(idle, devices_wanted=2), app={"suspend": True})
    assert condition(status, Condition.ALLOCATED) == ("True", Reason.ALLOCATED)
    assert message(status, Condition.ALLOCATED) == "domain 7; 0 of 2 devices"


@pytest.mark.parametrize(("asked", "said"), [(9, "spec.ros2.domain 9 is not used"), (7, ""), (None, "")])
def test_a_domain_asked_for_beside_share_with_is_said_to_be_unused(asked: int | None, said: str) -> None:
    ros2 = {"shareWith": [{"name": "leader"}], **({} if asked is None else {"domain": asked})}
    status = status_of(instance(UP, domain=7), app={"ros2": ros2})
    assert condition(status, Condition.ALLOCATED) == ("True", Reason.ALLOCATED)
    assert message(status, Condition.ALLOCATED).startswith("domain 7")
    assert message(status, Condition.ALLOCATED).partition("; ")[2].startswith(said)
    assert bool(said) == ("shareWith" in message(status, Condition.ALLOCATED))


def test_ros_1_without_devices_has_nothing_to_allocate() -> None:
    status = status_of(instance(domain=None, needs_domain=False), app={"ros": {"distro": "noetic"}})
    assert condition(status, Condition.ALLOCATED) == ("True", Reason.NOTHING_TO_ALLOCATE)


def test_the_schedulers_refusal_is_shown_with_counts() -> None:
    stuck = dataclasses.replace(WAITING, name="gpu", reason=Reason.UNSCHEDULABLE, message="0/5 nodes are available")
    status = status_of(instance(UP, stuck))
    assert condition(status, Condition.PLACED) == ("False", Reason.UNSCHEDULABLE)
    assert message(status, Condition.PLACED).startswith("1 of 2 placed; gpu: 0/5 nodes are available; kubectl robotapp")
    status = status_of(instance(UP, stuck), app={"schedulerName": "volcano"})
    assert message(status, Condition.PLACED) == "1 of 2 placed; gpu: 0/5 nodes are available", "we have no record of it"
    assert status["phase"] == Phase.PLACING


@pytest.mark.parametrize("reason", [Reason.CRASH_LOOP, Reason.IMAGE_PULL, Reason.FAILED_CREATE, Reason.QUOTA_REFUSED])
def test_failures_of_children_reach_ready_and_the_table(reason: Reason) -> None:
    failing = dataclasses.replace(STARTING, name="logger", reason=reason, message="the cause")
    status = status_of(instance(UP, failing))
    assert condition(status, Condition.READY) == ("False", reason)
    assert "1 of 2 components is ready; logger: the cause" in message(status, Condition.READY)
    assert status["summary"]["message"] == message(status, Condition.READY)
    assert status["phase"] == Phase.DEGRADED
    assert status["troubled"] == [{"instance": "", "reason": reason.value, "message": "logger: the cause"}]


def test_a_budget_that_is_exceeded_names_the_worst_edge() -> None:
    status = status_of(instance(edges=edges(p95_ms=61)))
    assert condition(status, Condition.BUDGET_MET) == ("False", Reason.BUDGET_EXCEEDED)
    assert "/cmd_vel operator -> driver 61ms of 30ms" in message(status, Condition.BUDGET_MET)
    assert status["summary"]["budget"] == "61/30ms"


def test_no_message_recommends_a_move_that_is_not_built() -> None:
    status = status_of(instance(edges=edges(p95_ms=61)))
    assert "reschedule" not in str(status)
    assert message(status, Condition.BUDGET_MET).endswith("move a component closer, or raise the budget")


def test_a_link_that_answers_no_probe_exceeds_the_budget_and_the_message_names_both_nodes() -> None:
    status = status_of(instance(edges=edges(p95_ms=None, lost=True)))
    assert condition(status, Condition.BUDGET_MET) == ("False", Reason.BUDGET_EXCEEDED)
    assert "/cmd_vel operator -> driver unreachable of 30ms" in message(status, Condition.BUDGET_MET)
    assert "probes between edge-1 and amr get no answer" in message(status, Condition.BUDGET_MET)
    assert status["summary"]["budget"] == "unreachable/30ms"


def test_an_unmeasured_budget_is_unknown() -> None:
    status = status_of(instance(edges=edges(p95_ms=None)))
    assert condition(status, Condition.BUDGET_MET) == ("Unknown", Reason.NOT_MEASURED)
    assert status["summary"]["budget"] == "?/30ms"


def test_a_budget_of_an_app_that_does_not_run_is_unknown() -> None:
    wrong = (Problem(Reason.INVALID_SPEC, "spec.ros", "wrong"),)
    refused = status_of(problems=wrong, app={"edges": [EDGE]})
    assert condition(refused, Condition.BUDGET_MET) == ("Unknown", Reason.INVALID_SPEC)
    assert condition(status_of(app={"edges": [EDGE]}), Condition.BUDGET_MET) == ("Unknown", Reason.NOT_MEASURED)


def test_without_budgets_nothing_is_exceeded() -> None:
    assert condition(status_of(instance()), Condition.BUDGET_MET) == ("True", Reason.NO_BUDGET)


SUSPENDED = dataclasses.replace(WAITING, name="mapper", suspended=True, message="suspended (replicas: 0)")
LATER = dataclasses.replace(
    WAITING, name="mapper", exists=False, waits=True, message="waits until driver is Ready (dependsOn)"
)


def test_a_suspended_component_is_not_wanted() -> None:
    status = status_of(instance(UP, SUSPENDED))
    assert condition(status, Condition.READY) == ("True", Reason.ALL_READY)
    assert condition(status, Condition.PLACED) == ("True", Reason.PLACED)
    assert (status["phase"], status["summary"]["ready"]) == (Phase.RUNNING, "1/1")


def test_an_app_whose_components_are_all_suspended_is_suspended() -> None:
    app = make_app(component("mapper", replicas=0))
    status = render_status(AppFacts(app=app, instances=(instance(SUSPENDED),), now="2026-01-01T00:00:00Z"))
    assert condition(status, Condition.READY) == ("False", Reason.SUSPENDED)
    assert "every component is suspended; set replicas: 1" in message(status, Condition.READY)
    assert (status["phase"], status["summary"]["ready"]) == (Phase.SUSPENDED, "0/0")


def test_a_component_that_waits_is_named_when_what_it_waits_for_has_no_trouble_of_its_own() -> None:
    status = status_of(instance(UP, LATER))
    assert (
        message(status, Condition.READY)
        == "1 of 2 components is ready; mapper: waits until driver is Ready (dependsOn)"
    )
    assert message(status, Condition.PLACED).endswith("; mapper waits until driver is Ready (dependsOn)")
    assert (status["phase"], status["troubled"]) == (Phase.PLACING, [])


def test_what_others_wait_for_is_named_before_them() -> None:
    failing = dataclasses.replace(STARTING, reason=Reason.CRASH_LOOP, message="restarted 3 times")
    for driver, text in ((failing, "driver: restarted 3 times"), (STARTING, "driver: is starting")):
        assert message(status_of(instance(LATER, driver)), Condition.READY) == f"0 of 2 components are ready; {text}"
    assert status_of(instance(LATER, failing))["phase"] == Phase.DEGRADED


def test_nothing_is_measured_while_suspended() -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}
    status = status_of(instance(WAITING), app={"suspend": True, "edges": [edge]})
    assert condition(status, Condition.BUDGET_MET) == ("Unknown", Reason.SUSPENDED)


@pytest.mark.parametrize(
    ("part", "total", "text"),
    [(1, 1, "1 of 1 edge is"), (0, 1, "0 of 1 edge is"), (1, 3, "1 of 3 edges is"), (0, 3, "0 of 3 edges are")],
)
def test_numbers_and_their_words_agree(part: int, total: int, text: str) -> None:
    assert count_of(part, total, "edge") == text


def test_suspended_apps_say_how_to_start_them() -> None:
    idle = dataclasses.replace(WAITING, replicas=0)
    status = status_of(instance(idle), app={"suspend": True})
    assert status["phase"] == Phase.SUSPENDED
    assert condition(status, Condition.READY) == ("False", Reason.SUSPENDED)
    assert condition(status, Condition.PLACED) == ("Unknown", Reason.SUSPENDED)
    assert status_of(instance(UP), app={"suspend": True})["phase"] == Phase.STOPPING


def test_a_robot_out_of_reach_is_offline_counted_and_named() -> None:
    status = status_of(instance(STARTING, robot="amr-07", robot_online=False))
    assert status["phase"] == Phase.OFFLINE
    assert status["instanceCounts"]["offline"] == 1
    assert condition(status, Condition.READY) == ("False", Reason.ROBOT_OFFLINE)
    assert "node n-amr-07" in status["troubled"][0]["message"]


def test_one_of_several_robots_out_of_reach_makes_the_app_degraded() -> None:
    away = instance(STARTING, robot="amr-07", robot_online=False)
    status = status_of(away, instance(UP, robot="amr-08"))
    assert (status["phase"], status["instanceCounts"]["offline"]) == (Phase.DEGRADED, 1)
    assert status_of(away, dataclasses.replace(away, instance=Instance("amr-08", "n")))["phase"] == Phase.OFFLINE


def test_an_app_that_no_robot_matches_yet_waits_and_has_not_failed() -> None:
    missing = Problem(Reason.NO_MATCHING_ROBOT, "spec.robots.nodeSelector", "no robot matches", of_cluster=True)
    status = status_of(problems=(missing,), app={"edges": [EDGE]})
    assert status["phase"] == Phase.PENDING
    assert condition(status, Condition.READY) == ("False", Reason.NO_MATCHING_ROBOT)
    assert condition(status, Condition.STALLED) == ("True", Reason.NO_MATCHING_ROBOT)
    assert message(status, Condition.STALLED).startswith("waits for a change of the cluster or of the spec: ")
    both = status_of(problems=(missing, Problem(Reason.INVALID_SPEC, "spec.ros", "wrong")))
    assert both["phase"] == Phase.FAILED


def test_what_ran_and_fails_is_degraded_what_starts_is_placing() -> None:
    starting = status_of(instance(STARTING))
    assert starting["phase"] == Phase.PLACING
    running = status_of(instance(UP), previous=starting)
    assert status_of(instance(STARTING), previous=running)["phase"] == Phase.DEGRADED


def barred_helper(why: str, name: str = "router", reason: Reason = Reason.UNSCHEDULABLE) -> HelperView:
    view = ComponentView(
        name=name, replicas=1, ready=False, exists=True, bound=False, rolling=False, reason=reason, message=why
    )
    return HelperView(HelperPart(name, name.partition("-")[0], "ros:humble-ros-base"), view)


def test_discovery_servers_whose_image_cannot_be_pulled_are_named_with_the_cure() -> None:
    why = 'ImagePullBackOff: Back-off pulling image "ros:humble-ros-base"'
    servers = tuple(barred_helper(why, f"discovery-{index}", Reason.IMAGE_PULL) for index in range(2))
    status = status_of(instance(STARTING, infrastructure_ready=False, helpers=servers))
    assert condition(status, Condition.READY) == ("False", Reason.IMAGE_PULL)
    assert f"discovery-0, discovery-1: {why}" in status["summary"]["message"]
    assert "spec.ros2.discovery.image" in message(status, Condition.READY)
    assert [item["reason"] for item in status["troubled"]] == [Reason.IMAGE_PULL]
    events = events_between({}, status, new_domains={})
    assert any(event.reason == EventReason.CHILD_FAILED and "discovery-0" in event.note for event in events)


def test_a_master_without_a_node_is_told_by_placed_as_well() -> None:
    status = status_of(
        instance(infrastructure_ready=False, helpers=(barred_helper("0/3 nodes are available", "master"),))
    )
    assert condition(status, Condition.PLACED) == ("False", Reason.UNSCHEDULABLE)
    assert "master: 0/3 nodes are available" in message(status, Condition.PLACED)


def test_a_second_server_that_fails_is_trouble_although_the_first_serves() -> None:
    up = barred_helper("", "discovery-0")
    up = up._replace(view=dataclasses.replace(up.view, ready=True, reason=None))
    status = status_of(instance(helpers=(up, barred_helper("exit code 1", "discovery-1", Reason.CRASH_LOOP))))
    assert condition(status, Condition.READY)[0] == "True"
    assert [(item["reason"], item["message"]) for item in status["troubled"]] == [
        (Reason.CRASH_LOOP, "discovery-1: exit code 1")
    ]


def test_missing_discovery_keeps_the_app_from_being_ready() -> None:
    status = status_of(instance(infrastructure_ready=False))
    assert condition(status, Condition.READY) == ("False", Reason.COMPONENTS_NOT_READY)
    assert "discovery or master" in message(status, Condition.READY)


def test_that_no_node_admits_the_infrastructure_is_told_at_once_and_before_that_components_start() -> None:
    """It travelled as an ordinary step of a start, so that it could wait, and was hidden while a component started."""
    why = "no node that it may use admits namespace x"
    before = status_of(instance())
    status = status_of(instance(infrastructure_ready=False, helpers=(barred_helper(why),)))
    ready = next(item for item in status["conditions"] if item["type"] == Condition.READY)
    assert (ready["reason"], why in ready["message"]) == ("Unschedulable", True)
    assert not is_progress({**before, "phase": "Placing"}, {**status, "phase": "Placing"})


def test_of_two_instances_the_one_whose_infrastructure_no_node_admits_is_in_trouble_and_not_the_one_that_starts() -> (
    None
):
    why = "no node that it may use admits namespace x"
    barred = instance(infrastructure_ready=False, helpers=(barred_helper(why),), robot="amr-2")
    status = status_of(instance(STARTING, robot="amr-1"), barred)
    assert [(item["instance"], item["reason"]) for item in status["troubled"]] == [("amr-2", "Unschedulable")]
    assert condition(status, Condition.READY) == ("False", Reason.UNSCHEDULABLE)
    assert f"amr-2: its discovery or master is not ready: router: {why}" in message(status, Condition.READY)


def test_held_templates_and_bugs_are_shown() -> None:
    held = status_of(instance(held=(Held("teleop-driver", ours="0.2.0"),)))
    assert condition(held, Condition.PROGRESSING) == ("False", Reason.UPDATE_HELD)
    assert read_approval(message(held, Condition.PROGRESSING)) == "0.2.0"
    assert condition(status_of(instance(), bug="KeyError in children"), Condition.STALLED) == (
        "True",
        Reason.RECONCILE_ERROR,
    )


def test_edits_that_a_newer_operators_templates_hold_back_are_counted_with_both_cures() -> None:
    held = (Held("teleop-driver", "0.10.0", "0.2.0"), Held("teleop-operator", "0.9.0", "0.2.0"))
    found = status_of(instance(UP, held=held))
    assert condition(found, Condition.PROGRESSING) == ("False", Reason.NEWER_VERSION)
    text = message(found, Condition.PROGRESSING)
    assert text.startswith("2 templates were written by operator 0.10.0, which is newer than this one (0.2.0): ")
    assert "run the newer operator again" in text
    assert read_approval(text) == "0.2.0"
    assert condition(found, Condition.READY)[0] == "True"
    assert found["summary"]["message"].startswith("2 templates were written by operator 0.10.0")
    assert found["summary"]["ready"] == "1/1 (2 held)", "the default table shows it: ready is not what the spec says"
    waits = status_of(instance(UP, held=(Held("teleop-driver"),)))
    assert waits["summary"]["ready"] == "1/1", "the user has asked for that"


def test_a_refused_child_stalls_the_app_with_the_servers_words() -> None:
    status = status_of(instance(WAITING, trouble=(Reason.QUOTA_REFUSED, "exceeded quota")))
    assert condition(status, Condition.STALLED) == ("True", Reason.QUOTA_REFUSED)
    assert condition(status, Condition.READY) == ("False", Reason.QUOTA_REFUSED)


def test_pods_without_a_discovery_server_are_named() -> None:
    status = status_of(instance(cut_off=("driver-1", "operator-2")))
    assert condition(status, Condition.STALLED) == ("True", Reason.RESTART_NEEDED)
    assert "driver-1, operator-2" in message(status, Condition.STALLED)


def test_a_thousand_instances_are_counted_and_ten_of_them_named() -> None:
    failing = dataclasses.replace(STARTING, reason=Reason.CRASH_LOOP, message="x" * 1024)
    crowd = [
        instance(*([failing] if number < 100 else [UP]), robot=f"r-{number:04}", domain=number % 200)
        for number in range(1000)
    ]
    status = status_of(*crowd, app={"robots": {"nodeSelector": {"matchLabels": {"a": "b"}}}})
    assert status["instanceCounts"] == {"desired": 1000, "ready": 900, "offline": 0, "completed": 0, "failed": 0}
    assert [item["instance"] for item in status["troubled"]] == [f"r-{number:04}" for number in range(10)]
    assert status["summary"]["ready"] == status["summary"]["robots"] == "900/1000"
    assert stored_bytes(status) < MAX_STATUS_BYTES


def test_an_app_with_an_unclear_robot_is_accepted_and_the_others_go_on() -> None:
    lost = dataclasses.replace(WAITING, exists=False)
    unclear = dataclasses.replace(
        instance(lost, robot="b", domain=None), instance=Instance("b", "", "robot b has 2 nodes: label one")
    )
    status = status_of(instance(robot="a"), unclear)
    assert condition(status, Condition.ACCEPTED) == ("True", Reason.ACCEPTED)
    assert "1 of 2 instances are for robots whose primary node is unclear (b)" in message(status, Condition.ACCEPTED)
    assert condition(status, Condition.READY) == ("False", Reason.ROBOT_NODE_UNCLEAR)
    assert condition(status, Condition.PROGRESSING) == ("False", Reason.ROBOT_NODE_UNCLEAR)
    assert condition(status, Condition.ALLOCATED) == ("Unknown", Reason.ROBOT_NODE_UNCLEAR)
    assert status["instanceCounts"] == {"desired": 2, "ready": 1, "offline": 0, "completed": 0, "failed": 1}
    assert status["troubled"] == [
        {"instance": "b", "reason": "RobotNodeUnclear", "message": "robot b has 2 nodes: label one"}
    ]


def test_a_robot_whose_name_does_not_fit_into_the_spec_is_in_trouble_alone() -> None:
    lost = dataclasses.replace(WAITING, exists=False)
    text = "spec.components[0].envFrom[0].configMapRef.name: env-$(ROBOTAPP_ROBOT) is for robot B"
    misnamed = dataclasses.replace(instance(lost, robot="B", domain=None), instance=Instance("B", "node-of-b", text))
    status = status_of(instance(robot="a"), misnamed)
    assert condition(status, Condition.ACCEPTED) == ("True", Reason.ACCEPTED)
    assert "1 of 2 instances are for robots whose name does not fit into the spec (B)" in message(
        status, Condition.ACCEPTED
    )
    assert condition(status, Condition.READY) == ("False", Reason.INVALID_SPEC)
    assert condition(status, Condition.PROGRESSING) == ("False", Reason.INVALID_SPEC)
    assert condition(status, Condition.ALLOCATED) == ("Unknown", Reason.INVALID_SPEC)
    assert status["troubled"] == [{"instance": "B", "reason": "InvalidSpec", "message": text}]


def test_what_is_accepted_without_effect_is_said() -> None:
    status = status_of(instance(), notes=("devices[0].count: 1 is used",))
    assert message(status, Condition.ACCEPTED) == "the spec is understood; devices[0].count: 1 is used"


def test_robots_are_counted_when_the_app_has_some() -> None:
    robots = {"nodeSelector": {"matchLabels": {"a": "b"}}}
    status = status_of(instance(robot="a"), instance(STARTING, robot="b"), app={"robots": robots})
    assert status["summary"]["robots"] == "1/2"
    assert status["summary"]["ready"] == "1/2"


def test_before_any_instance_the_table_shows_what_is_wanted() -> None:
    status = status_of()
    assert status["summary"]["ready"] == "0/2"
    assert status["phase"] == Phase.PENDING


@pytest.mark.parametrize(
    ("ids", "text"),
    [(set(), ""), ({7}, "7"), ({7, 8, 9}, "7-9"), ({9, 7, 12}, "7,9,12"), ({1, 2, 5, 6, 7}, "1-2,5-7")],
)
def test_domains_are_shown_as_ranges(ids: set[int], text: str) -> None:
    assert ranges(ids) == text


def test_more_domains_than_fit_are_counted() -> None:
    text = domains_text(range(1, 120, 2))
    assert len(text) <= 63
    assert text.startswith("1,3,5,")
    assert text.endswith(",… (60)")


def test_after_a_masters_restart_its_nodes_must_restart() -> None:
    master = barred_helper("", "master")
    master = master._replace(view=dataclasses.replace(master.view, ready=True, reason=None))
    status = status_of(instance(helpers=(master,), cut_off=("teleop-driver-x",)))
    assert condition(status, Condition.STALLED) == ("True", Reason.RESTART_NEEDED)
    assert "the master was started anew since teleop-driver-x started" in message(status, Condition.STALLED)
