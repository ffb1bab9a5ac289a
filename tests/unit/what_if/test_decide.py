"""What would be, decided on the cache of a scheduler."""

from typing import Any

import pytest
from tests.support.scheduler.late_apps import COMPONENTS, edge, measure, placed, robot_and_servers
from tests.support.scheduling import (
    app_object,
    chain,
    device_claim,
    make_core,
    make_node,
    make_pod,
    member_pod,
    owner,
    telemetry,
)

from robotapp_api.model.names import API_VERSION, SCHEDULER_NAME, Label
from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.what_if import decide
from robotapp_scheduler.what_if.app_pods import MOST_PODS
from robotapp_scheduler.what_if.difference import Answer, EdgeChange, EdgeState, EdgeVerdict, Outcome, PodChange
from robotapp_scheduler.what_if.question import Question, QuestionError, RoundTrip, UnknownNodeError


def answer(core: SchedulerCore, **asked: Any) -> Answer:
    return decide.answer(core, Question(**asked), None, clock=lambda: 0.0)


def lost(core: SchedulerCore, *nodes: str) -> Answer:
    return answer(core, node_loss=nodes)


def slow(one: str, other: str, rtt: str) -> tuple[RoundTrip, ...]:
    return (RoundTrip(one, other, rtt),)


def only(answer: Answer) -> PodChange:
    (found,) = answer.pods
    return found


def replica(name: str, node: str, **fields: Any) -> Any:
    return make_pod(name, node=node, owner=owner("ReplicaSet", "rs", "rs-1"), **fields)


def app(*components: dict[str, Any], name: str = "new", **spec: Any) -> dict[str, Any]:
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": name, "namespace": "default"},
        "spec": {"components": list(components), **spec},
    }


def states(change: EdgeChange) -> tuple[EdgeState, EdgeState]:
    assert change.before is not None
    assert change.after is not None
    return change.before, change.after


# --- Lost nodes ---------------------------------------------------------------------------------------------------------


def test_the_component_of_a_lost_server_moves_and_its_edge_leaves_or_keeps_its_budget() -> None:
    core = robot_and_servers()
    measure(core, {"e1": 12.0, "e3": 50.0})
    found = lost(core, "e1")
    moved = only(found)
    assert (moved.component, moved.outcome, moved.from_, moved.to) == ("planner", Outcome.MOVES, "e1", "e2")
    assert (found.edges, found.edges_unchanged) == ((), 1), "12 ms before and 8 ms after, of 20 ms"


def test_an_edge_over_its_budget_is_met_again_where_the_component_moves() -> None:
    (edge_of_planner,) = lost(robot_and_servers(), "e1").edges
    before, after = states(edge_of_planner)
    assert (before.rtt_ms, before.verdict, after.rtt_ms, after.verdict) == (
        60.0,
        EdgeVerdict.EXCEEDED,
        8.0,
        EdgeVerdict.MET,
    )


def test_a_component_on_board_stays_on_its_lost_robot_and_nothing_answers_there() -> None:
    core = robot_and_servers()
    measure(core, {"e1": 12.0})
    found = lost(core, "amr")
    assert (only(found).component, only(found).outcome) == ("driver", Outcome.STAYS)
    _, after = states(found.edges[0])
    assert (after.rtt_ms, after.verdict) == (None, EdgeVerdict.EXCEEDED)


def test_a_component_that_stops_waits_for_its_node() -> None:
    core = robot_and_servers(components=(COMPONENTS[0], {"name": "planner", "onDisconnect": "Stop"}))
    found = only(lost(core, "e1"))
    assert (found.outcome, found.code, found.to) == (Outcome.PENDING, "WaitingForPredecessor", "")
    assert "waiting for its predecessor teleop-planner-abc-planner on e1 to end" in found.reason


def test_a_pod_that_fits_nowhere_else_is_pending_with_the_text_of_its_condition() -> None:
    core = robot_and_servers()
    for name in ("e2", "e3"):
        core.cluster.apply_pod(make_pod(f"load-{name}", node=name, cpu="1500m"))
    found = only(lost(core, "e1"))
    assert (found.outcome, found.code) == (Outcome.PENDING, "Unschedulable")
    assert found.reason.startswith("0/4 nodes are available: ")


def test_pods_of_replica_sets_move_others_end_wait_or_stay() -> None:
    core = make_core(make_node("n1"), make_node("n2"))
    core.cluster.apply_pod(replica("web", "n1"))
    core.cluster.apply_pod(make_pod("bare", node="n1"))
    core.cluster.apply_pod(make_pod("every", node="n1", owner=owner("DaemonSet", "ds", "ds-1")))
    core.cluster.apply_pod(make_pod("db-0", node="n1", owner=owner("StatefulSet", "db", "db-1")))
    core.cluster.apply_pod(replica("tolerant", "n1", tolerations=[{"operator": "Exists"}]))
    core.cluster.apply_pod(replica("foreign", "n1", scheduler="default-scheduler"))
    core.cluster.apply_pod(replica("elsewhere", "n2"))
    found = lost(core, "n1")
    assert {each.pod: (each.outcome, each.to) for each in found.pods} == {
        "web": (Outcome.MOVES, "n2"),
        "bare": (Outcome.ENDS, ""),
        "every": (Outcome.STAYS, ""),
        "tolerant": (Outcome.STAYS, ""),
        "db-0": (Outcome.PENDING, ""),
    }
    assert "1 pod of another scheduler is on n1: where they go is not decided here" in found.notes


def test_a_lost_program_of_robotapp_itself_is_named_with_what_is_lacking() -> None:
    core = make_core(make_node("n1"), make_node("n2"))
    for name in ("operator", "scheduler", "agent"):
        labels = {"app.kubernetes.io/part-of": "robotapp", "app.kubernetes.io/component": name}
        core.cluster.apply_pod(replica(name, "n1", scheduler="default-scheduler", labels=labels))
    notes = lost(core, "n1").notes
    assert any("RobotApp's own scheduler default/scheduler is on n1" in note for note in notes), notes
    assert any("RobotApp's own operator" in note and "no app is changed" in note for note in notes)
    assert not any("own agent" in note for note in notes)
    assert "3 pods of other schedulers are on n1: where they go is not decided here" in notes


SILENT = {"key": "node.kubernetes.io/unreachable", "operator": "Exists", "effect": "NoExecute"}


@pytest.mark.parametrize(
    ("tolerations", "outcome"),
    [
        ([SILENT], Outcome.STAYS),
        ([{"operator": "Exists", "effect": "NoExecute"}], Outcome.STAYS),
        ([SILENT | {"tolerationSeconds": 300}], Outcome.MOVES),
        ([{"operator": "Exists", "tolerationSeconds": 30}], Outcome.MOVES),
        ([{"operator": "Exists", "effect": "NoSchedule"}], Outcome.MOVES),
        ([SILENT | {"tolerationSeconds": 30}, {"operator": "Exists"}], Outcome.MOVES),
        ([{"operator": "Exists"}, SILENT | {"tolerationSeconds": 30}], Outcome.STAYS),
    ],
)
def test_a_pod_stays_if_the_first_toleration_of_a_silent_node_has_no_end(
    tolerations: list[dict[str, Any]], outcome: Outcome
) -> None:
    core = make_core(make_node("n1"), make_node("n2"))
    core.cluster.apply_pod(replica("web", "n1", tolerations=tolerations))
    assert only(lost(core, "n1")).outcome == outcome


def test_when_both_nodes_are_lost_nothing_fits() -> None:
    core = make_core(make_node("n1"), make_node("n2"))
    core.cluster.apply_pod(replica("web", "n1"))
    assert only(lost(core, "n1", "n2")).outcome == Outcome.PENDING


def test_a_node_that_is_not_there_is_an_error() -> None:
    with pytest.raises(UnknownNodeError, match="no node 'e9'"):
        lost(robot_and_servers(), "e9")


# --- Round trips --------------------------------------------------------------------------------------------------------


def test_a_slow_pair_breaks_the_budget_and_a_better_node_is_named() -> None:
    core = robot_and_servers(placement={"reschedule": {"when": "BudgetExceeded"}})
    measure(core, {"e1": 12.0})
    found = answer(core, rtt=slow("e1", "amr", "40ms"))
    before, after = states(found.edges[0])
    assert (before.verdict, after.rtt_ms, after.source, after.verdict) == (
        EdgeVerdict.MET,
        40.0,
        "measured",
        EdgeVerdict.EXCEEDED,
    )
    moved = only(found)
    assert (moved.outcome, moved.from_, moved.to) == (Outcome.MOVES, "e1", "e2")
    assert moved.reason == "/planner to driver: 40ms of 20ms, 8ms there"


def test_two_components_that_would_move_to_the_only_free_place_do_not_both_get_it() -> None:
    core = robot_and_servers(placement={"reschedule": {"when": "BudgetExceeded"}})
    measure(core, {"e1": 12.0, "e3": 50.0})
    core.cluster.apply_pod(make_pod("load", node="e2", cpu="500m"))
    second = app_object(
        *COMPONENTS, name="second", uid="second", edges=[edge("planner", "driver")],
        placement={"reschedule": {"when": "BudgetExceeded"}},
    )  # fmt: skip
    core.cluster.apply_app(second)
    for component in ("driver", "planner"):
        for owned in chain(component, app="second", app_uid="second"):
            core.cluster.apply_owner(owned)
    of_second = {"app": "second", "app_uid": "second"}
    core.cluster.apply_pod(placed("driver", "amr", uid="driver-2", **of_second, cpu="1m"))
    core.cluster.apply_pod(placed("planner", "e1", uid="planner-2", **of_second))
    found = answer(core, rtt=slow("e1", "amr", "90ms"))
    assert (only(found).outcome, only(found).to) == (Outcome.MOVES, "e2")
    assert [states(each)[1].rtt_ms for each in found.edges] == [90.0, 90.0], "before they move"


@pytest.mark.parametrize(
    ("reschedule", "why"),
    [
        ({}, "placement.reschedule.when is not BudgetExceeded"),
        ({"when": "BudgetExceeded", "maxPerDay": 0}, "placement.reschedule.maxPerDay is 0"),
    ],
)
def test_an_app_that_has_not_opted_in_may_move_and_does_not(reschedule: dict[str, Any], why: str) -> None:
    core = robot_and_servers(placement={"reschedule": reschedule})
    measure(core, {"e1": 12.0})
    found = only(answer(core, rtt=slow("amr", "e1", "40ms")))
    assert (found.outcome, found.to) == (Outcome.MAY_MOVE, "e2")
    assert found.reason.endswith(why)


def test_a_pair_that_stays_within_the_budget_changes_nothing_and_so_does_one_of_others() -> None:
    core = robot_and_servers()
    measure(core, {"e1": 12.0})
    found = answer(core, rtt=slow("amr", "e1", "19ms"))
    assert (found.pods, found.edges, found.edges_unchanged) == ((), (), 1)
    found = answer(core, rtt=slow("e2", "e3", "19ms"))
    assert (found.pods, found.edges, found.edges_unchanged) == ((), (), 0)


def test_a_lost_node_and_a_slow_pair_together_leave_the_third_node() -> None:
    core = robot_and_servers()
    found = answer(core, node_loss=("e1",), rtt=slow("amr", "e2", "70ms"))
    assert only(found).to == "e3"


# --- Apps ---------------------------------------------------------------------------------------------------------------


def test_a_new_app_is_placed_whole_with_its_edges() -> None:
    core = robot_and_servers()
    new = app({"name": "a", "runsOn": ["Robot"]}, {"name": "b"}, edges=[edge("a", "b")],
              robots={"nodeSelector": {"matchLabels": {str(Label.ROBOT): "amr"}}})  # fmt: skip
    core.cluster.remove_pod(core.cluster.placed["driver"].pod)
    found = answer(core, apps=(new,))
    places = {each.component: (each.outcome, each.to) for each in found.pods}
    assert places["a"] == (Outcome.PLACED, "amr")
    assert places["b"][0] == Outcome.PLACED
    assert {each.instance for each in found.pods} == {"amr"}
    (change,) = found.edges
    assert change.before is None
    assert change.after is not None
    assert change.after.verdict == EdgeVerdict.MET


@pytest.mark.parametrize(("steps", "outcome"), [(["RelaxPreferred"], Outcome.MOVES), (["Wait"], Outcome.PENDING)])
def test_a_preferred_budget_is_given_up_in_the_end_where_the_app_allows_it(steps: list[str], outcome: Outcome) -> None:
    preferred = [edge("planner", "driver", enforce="Preferred")]
    core = robot_and_servers(edges=preferred, placement={"fallback": {"steps": steps}})
    measure(core, {"e1": 12.0, "e2": 50.0, "e3": 70.0})
    found = only(lost(core, "e1"))
    assert (found.outcome, found.to) == (outcome, "e2" if outcome == Outcome.MOVES else "")


def test_an_app_that_runs_is_compared_with_where_it_is() -> None:
    core = robot_and_servers()
    changed = app(*COMPONENTS, name="teleop", edges=[edge("planner", "driver")],
                  robots={"nodeSelector": {"matchLabels": {str(Label.ROBOT): "amr"}}})  # fmt: skip
    found = answer(core, apps=(changed,))
    assert [(each.component, each.outcome, each.from_) for each in found.pods] == [("planner", Outcome.MOVES, "e1")]
    assert any("teleop runs" in note for note in found.notes)
    before, after = states(found.edges[0])
    assert (before.verdict, after.verdict) == (EdgeVerdict.EXCEEDED, EdgeVerdict.MET)


def test_an_app_that_runs_goes_on_using_its_devices_and_loses_the_pods_it_needs_no_more() -> None:
    camera = {"name": "cam", "type": "usb"}
    core = make_core(make_node("n1"), make_node("n2"))
    core.cluster.apply_telemetry(telemetry("n1", devices=[{"id": "usb-cam", "type": "usb"}]))
    core.cluster.apply_app(app_object({"name": "eye", "devices": [camera]}, {"name": "log"}))
    for name in ("eye", "log"):
        for owned in chain(name):
            core.cluster.apply_owner(owned)
        core.cluster.apply_pod(member_pod(name, node="n1"))
    core.cluster.apply_claim(device_claim("n1", "usb-cam", uid="app-1", component="eye", holder_name="teleop"))
    changed = app({"name": "eye", "devices": [camera], "resources": {"requests": {"cpu": "2"}}}, name="teleop")
    found = answer(core, apps=(changed,))
    assert [(each.component, each.outcome, each.from_) for each in found.pods] == [("log", Outcome.ENDS, "n1")]
    another = answer(core, apps=(app({"name": "eye", "devices": [camera]}, name="rival"),))
    assert only(another).outcome == Outcome.PENDING, "the camera is held"


def test_a_replaced_app_on_a_lost_node_is_placed_once() -> None:
    core = robot_and_servers()
    changed = app(*COMPONENTS, name="teleop", edges=[edge("planner", "driver")],
                  robots={"nodeSelector": {"matchLabels": {str(Label.ROBOT): "amr"}}})  # fmt: skip
    found = answer(core, apps=(changed,), node_loss=("e1",))
    assert [(each.component, each.outcome, each.from_) for each in found.pods] == [("planner", Outcome.MOVES, "e1")]
    assert only(found).to not in ("", "e1")


def test_what_an_app_requests_decides_limits_included() -> None:
    core = make_core(make_node("small", cpu="1"), make_node("large", cpu="8"))
    big = {"name": "big", "resources": {"limits": {"cpu": "4"}}}
    picky = {"name": "picky", "template": {"spec": {"nodeSelector": {"kubernetes.io/hostname": "small"}}}}
    huge = {"name": "huge", "resources": {"requests": {"cpu": "64"}}}
    found = answer(core, apps=(app(big, picky, huge, placement={"gang": "None"}),))
    assert {each.component: each.to for each in found.pods} == {"big": "large", "picky": "small", "huge": ""}


def test_apps_that_cannot_be_read_are_errors_and_those_without_pods_are_explained() -> None:
    core = make_core(make_node("n1"))
    for spec, text in (
        ({"components": [{"name": 7}]}, "cannot be read"),
        ({"components": "x"}, "cannot be read"),
        ({"components": [{"name": "a"}], "schedulerName": "theirs"}, "'theirs' is none of this scheduler's"),
        ({"components": [{"name": "a"}, {"name": "b"}, {"name": "a"}]}, "several components have one name"),
        ({"components": [{"name": "a", "replicas": -1}]}, "a has a negative number of replicas"),
        ({"components": [{"name": "a", "replicas": MOST_PODS + 1}]}, f"more than {MOST_PODS} pods"),
    ):
        with pytest.raises(QuestionError, match=text):
            answer(core, apps=({**app(), "spec": spec},))
    found = answer(core, apps=(app({"name": "a"}, suspend=True),))
    assert (found.pods, found.notes[0]) == ((), "RobotApp default/new is suspended: it has no pods")
    found = answer(core, apps=(app({"name": "a"}, robots={"nodeSelector": {"matchLabels": {"x": "y"}}}),))
    assert "names no robot" in found.notes[0]
    found = answer(core, apps=(app({"name": "a", "resources": {"requests": {"cpu": "much"}}}),))
    assert "much" in only(found).reason


# --- Configuration ------------------------------------------------------------------------------------------------------


def test_another_configuration_shows_which_pods_would_go_elsewhere_if_placed_again() -> None:
    core = make_core(make_node("empty", cpu="8"), make_node("full", cpu="8"))
    core.cluster.apply_pod(replica("load", "full", cpu="4", scheduler="default-scheduler"))
    core.cluster.apply_pod(replica("web", "empty", cpu="1"))
    most = {"name": "NodeResourcesFit", "args": {"scoringStrategy": {
        "type": "MostAllocated", "resources": [{"name": "cpu", "weight": 100}]}}}  # fmt: skip
    config = configuration.parse(
        {
            "apiVersion": "kubescheduler.config.k8s.io/v1",
            "kind": "KubeSchedulerConfiguration",
            "profiles": [
                {
                    "schedulerName": SCHEDULER_NAME,
                    "pluginConfig": [most],
                    "plugins": {
                        "multiPoint": {
                            "disabled": [{"name": "NodeResourcesBalancedAllocation"}, {"name": "LoadBalanceScore"}]
                        }
                    },
                }
            ],
        },
        catalogue=catalogue(),
    )
    found = decide.answer(core, Question(config={"kind": "x"}), config, clock=lambda: 0.0)
    assert (only(found).pod, only(found).outcome, only(found).to) == ("web", Outcome.MAY_MOVE, "full")
    assert any(note.startswith("1 of 1 running pods") for note in found.notes)


# --- Apps that run --------------------------------------------------------------------------------------------------------

ANY_ROBOT = {"nodeSelector": {"matchExpressions": [{"key": str(Label.ROBOT), "operator": "Exists"}]}}
DRIVER = {"name": "driver", "runsOn": ["Robot"]}


def on_robots(*robots: str, running: str) -> SchedulerCore:
    """The app `teleop` runs on one of these robots."""
    core = make_core(*(make_node(name, labels={str(Label.ROBOT): name}) for name in robots))
    core.cluster.apply_app(app_object(DRIVER))
    for owned in chain("driver"):
        core.cluster.apply_owner(owned)
    core.cluster.apply_pod(member_pod("driver", instance=running, node=running, uid="d"))
    return core


@pytest.mark.parametrize("running", ["amr-0", "amr-1", "amr-2", "amr-3"])
def test_an_app_for_any_robot_stays_on_the_one_where_it_runs(running: str) -> None:
    core = on_robots("amr-0", "amr-1", "amr-2", "amr-3", running=running)
    tried = app(DRIVER, name="teleop", robots={**ANY_ROBOT, "assignment": "Any"})
    assert answer(core, apps=(tried,)).pods == ()


def test_what_runs_on_a_robot_that_no_node_shows_goes_on() -> None:
    core = on_robots("amr-0", "amr-1", running="amr-1")
    core.cluster.apply_node(make_node("amr-1"))  # a tool took its labels off
    found = answer(core, apps=(app(DRIVER, name="teleop", robots=ANY_ROBOT),))
    assert [(each.instance, each.outcome) for each in found.pods] == [("amr-0", Outcome.PLACED)]
    assert core.cluster.placed["d"].node == "amr-1"


def test_an_edge_that_is_written_before_another_changes_nothing_about_that_one() -> None:
    core = robot_and_servers()
    measure(core, {"e1": 12.0})
    parts = ({"name": "driver", "runsOn": ["Robot"]}, {"name": "planner"})
    robots = {"nodeSelector": {"matchLabels": {str(Label.ROBOT): "amr"}}}
    first = {"topic": "/new", "from": "driver", "to": "planner", "latency": {"budget": "20ms"}}
    found = answer(core, apps=(app(*parts, name="teleop", robots=robots, edges=[first, edge("planner", "driver")]),))
    assert [(each.edge, each.before) for each in found.edges] == [("/new", None)]
    assert found.edges_unchanged == 1


def test_what_no_probe_measures_is_estimated_two_ends_on_one_node_too() -> None:
    core = robot_and_servers()
    near = {"nodeSelector": {"kubernetes.io/hostname": "amr"}}
    parts = (
        {"name": "driver", "runsOn": ["Robot"]},
        {"name": "planner", "template": {"spec": near}, "runsOn": ["Robot"]},
    )
    robots = {"nodeSelector": {"matchLabels": {str(Label.ROBOT): "amr"}}}
    found = answer(core, apps=(app(*parts, name="other", robots=robots, edges=[edge("planner", "driver")]),))
    (change,) = found.edges
    assert change.after is not None
    assert (change.after.rtt_ms, change.after.source) == (0.05, "estimated")


def test_a_node_that_is_lost_twice_is_lost_once() -> None:
    core = make_core(make_node("n1"), make_node("n2"))
    core.cluster.apply_pod(make_pod("bare", node="n1"))
    core.cluster.apply_pod(replica("foreign", "n1", scheduler="default-scheduler"))
    once, twice = lost(core, "n1"), lost(core, "n1", "n1")
    assert [each.pod for each in twice.pods] == [each.pod for each in once.pods] == ["bare"]
    assert len(twice.notes) == len(once.notes)


def test_a_pod_has_one_answer_and_supposed_ones_do_not_count_as_running() -> None:
    core = make_core(make_node("n1"), make_node("n2"))
    core.cluster.apply_pod(make_pod("bare", node="n1"))
    core.cluster.apply_pod(replica("web", "n2"))
    empty = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
    config = configuration.parse(empty, catalogue=catalogue())
    question = Question(config=empty, node_loss=("n1",), apps=(app({"name": "a", "replicas": 3}),))
    found = decide.answer(core, question, config, clock=lambda: 0.0)
    assert [each.pod for each in found.pods].count("bare") == 1
    assert "1 of 2 running pods were placed again with the configuration, the latest first" in found.notes
