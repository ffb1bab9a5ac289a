"""PodGroups of both APIs: enough pods are there, planned together, all or none, late members one by one."""

from typing import Any

import msgspec
import pytest
from tests.support.scheduler.pod_groups import (
    announce,
    arrive,
    confirm,
    depart,
    pod_group,
    run,
    team_pod,
    tell,
    workload_group,
    workload_pod,
)
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import Clock, app_object, make_core, make_info, make_node, make_pod, member_pod

from robotapp_api.model.names import Label, PodReason
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.pod_group import understood
from robotapp_scheduler.core.cycle.group_gates import WHOLE_PLUGIN, groups_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.pods.pod_group_index import (
    COSCHEDULING,
    POD_GROUP_LABEL,
    WORKLOADS,
    GroupRef,
    group_ref_of,
)


def team(count: int, *, first: int = 0, **fields: Any) -> list[Pod]:
    return [team_pod(f"p{i}", **{"cpu": "1", **fields}) for i in range(first, first + count)]


def small_nodes(count: int) -> SchedulerCore:
    """Each takes one pod of `team`."""
    return make_core(*(make_node(f"n{i}", cpu="1500m") for i in range(count)))


def reasons(core: SchedulerCore) -> list[str]:
    return [queued.gate.reason for queued in core.queue.gated() if queued.gate is not None]


def test_pods_wait_for_their_group_and_for_enough_of_each_other() -> None:
    core = small_nodes(5)
    arrive(core, *team(2))
    assert reasons(core) == ["waiting for PodGroup team (scheduling.x-k8s.io) to be seen"] * 2
    announce(core, pod_group(min_member=3))
    assert "waiting for pods of PodGroup team (2 of 3)" in reasons(core)
    assert run(core) == {}
    arrive(core, *team(1, first=2))
    assert set(run(core)) == {"p0", "p1", "p2"}


def test_none_is_placed_where_only_four_of_five_fit_and_all_once_there_is_room() -> None:
    core = small_nodes(4)
    announce(core, pod_group(min_member=5))
    pods = team(5)
    arrive(core, *pods)
    decisions = {decision.pod.name: decision for decision in core.schedule(core.queue.pop())}
    assert not any(decision.placed for decision in decisions.values())
    assert core.cluster.placed == {}
    texts = sorted(decision.message for decision in decisions.values())
    assert texts[0].startswith("0/4 nodes are available: 4 Insufficient cpu.")
    stuck = next(name for name, decision in decisions.items() if decision.message == texts[0])
    assert set(texts[1:]) == {
        f"pod group is unschedulable, minCount (5) cannot be satisfied: 4 scheduled, 0 remaining; {stuck}: {texts[0]}"
    }
    fitted = next(decision for decision in decisions.values() if decision.message != texts[0])
    assert fitted.rejected_by == {"NodeResourcesFit", WHOLE_PLUGIN}
    record = core.explain.get(fitted.pod.uid)
    assert record is not None
    assert (record.node, record.message) == (None, fitted.message)


def test_room_brings_the_whole_group_back() -> None:
    core = small_nodes(4)
    announce(core, pod_group(min_member=5))
    arrive(core, *team(5))
    assert run(core) == {}
    node = make_node("n4", cpu="1500m")
    core.queue.move(Event("nodes", core.cluster.apply_node(node), None, node))
    assert len(run(core)) == 5


def test_a_group_that_asks_for_less_is_tried_again_at_once_and_another_one_is_not() -> None:
    core = small_nodes(2)
    for name in ("team", "other"):
        announce(core, pod_group(name, min_member=3))
        arrive(core, *(team_pod(f"{name}-{i}", group=name, cpu="1") for i in range(3)))
    assert run(core) == {}
    announce(core, pod_group(min_member=3))
    assert core.queue.pending()["unschedulable"] == 6, "nothing has changed"
    announce(core, pod_group(min_member=2))
    assert sorted(name.partition("-")[0] for name in run(core)) == ["team", "team"]
    assert core.queue.pending()["unschedulable"] == 4


def test_pods_of_a_plan_that_failed_by_a_bug_are_spared_no_longer_than_others() -> None:
    core = small_nodes(3)
    announce(core, pod_group(min_member=3))
    arrive(core, *team(3))
    with pytest.raises(AttributeError):
        core.schedule(core.queue.pop(), placement=object())  # type: ignore[arg-type]  # the bug
    for number in range(3):
        core.cluster.apply_pod(team_pod(f"p{number}", cpu="1", node=f"n{number}"))
    assert core.schedule_one(make_info("vip", cpu="1", priority=10)).plan is not None


def test_members_beyond_the_minimum_do_not_hold_the_others() -> None:
    core = small_nodes(4)
    announce(core, pod_group(min_member=3))
    arrive(core, *team(5))
    assert len(run(core)) == 4


def test_after_a_bind_failed_the_rest_goes_together_against_the_bound_ones() -> None:
    core = small_nodes(5)
    announce(core, pod_group(min_member=5))
    pods = team(5)
    arrive(core, *pods)
    assert len(run(core, lose={"p3", "p4"})) == 3
    confirm(core, pods)
    full = make_pod(
        "full", cpu="1", node=next(iter({f"n{i}" for i in range(5)} - {r.node for r in core.cluster.placed.values()}))
    )
    core.cluster.apply_pod(full)
    core.queue.activate([pod.metadata.uid for pod in pods])
    assert run(core) == {}, "one of two is not enough"
    core.queue.move(core.cluster.remove_pod(full))
    core.queue.activate([pod.metadata.uid for pod in pods])
    assert set(run(core)) == {"p3", "p4"}


def test_a_late_member_is_placed_by_itself_also_when_others_have_ended() -> None:
    core = small_nodes(6)
    announce(core, pod_group(min_member=3))
    pods = team(3)
    arrive(core, *pods)
    assert len(run(core)) == 3
    confirm(core, pods)
    depart(core, *pods[:2])
    arrive(core, *team(1, first=7))
    assert set(run(core)) == {"p7"}


def test_when_all_are_gone_the_next_ones_must_be_enough_again() -> None:
    core = small_nodes(6)
    announce(core, pod_group(min_member=2))
    pods = team(2)
    arrive(core, *pods)
    run(core)
    confirm(core, pods)
    depart(core, *pods)
    arrive(core, *team(1, first=7))
    assert run(core) == {}


def test_a_restarted_scheduler_believes_the_groups_status() -> None:
    core = small_nodes(6)
    group = pod_group(min_member=3)
    group.status = {"phase": "Running"}
    announce(core, group)
    arrive(core, team_pod("old", cpu="1", node="n0"), *team(1))
    assert set(run(core)) == {"p0"}


def test_pods_that_end_or_are_held_by_gates_of_their_own_are_not_counted() -> None:
    core = small_nodes(5)
    announce(core, pod_group(min_member=3))
    gated = team_pod("held", cpu="1", schedulingGates=[{"name": "quota"}])
    ending = team_pod("ending", cpu="1", node="n0")
    ending.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    arrive(core, *team(2), gated, ending)
    assert "waiting for pods of PodGroup team (2 of 3)" in reasons(core)


def test_a_group_of_the_workload_api_is_planned_by_its_policy() -> None:
    for policy, placed in (({"gang": {"minCount": 3}}, 0), ({"basic": {}}, 2)):
        core = small_nodes(2)
        announce(core, workload_group(policy=policy), WORKLOADS)
        arrive(core, *(workload_pod(f"w{i}", cpu="1") for i in range(3)))
        assert len(run(core)) == placed


def test_what_a_group_asks_for_and_we_do_not_do_is_said() -> None:
    core = small_nodes(5)
    topology = {"schedulingConstraints": {"topology": [{"key": "zone"}]}}
    announce(core, workload_group(policy={"gang": {"minCount": 1}}, spec=topology), WORKLOADS)
    arrive(core, workload_pod("w0"))
    assert "schedulingConstraints.topology, which this scheduler does not support" in reasons(core)[0]


def test_an_incomplete_group_says_so_after_its_own_time_with_the_newest_count() -> None:
    clock = Clock()
    core = make_core(make_node("n"), clock=clock)
    announce(core, pod_group(min_member=9, scheduleTimeoutSeconds=20))
    arrive(core, *team(2))
    arrive(core, *team(1, first=2))
    clock.forward(19)
    assert core.held() == []
    clock.forward(1)
    held = core.held()
    assert len(held) == 3
    for _, gate in held:
        assert (gate.code, gate.reason) == (PodReason.WAITING_FOR_GROUP, "waiting for pods of PodGroup team (3 of 9)")


def test_without_a_timeout_a_minute_passes_first() -> None:
    groups = [pod_group(), pod_group(scheduleTimeoutSeconds=0), pod_group(scheduleTimeoutSeconds=-5)]
    assert [understood(group).spec.report_after_s for group in groups] == [60.0] * 3


WRONG = "PodGroup team cannot be planned: field {} is not valid; allowed: {}"
NUMBER = "a whole number up to 2147483647"


@pytest.mark.parametrize(
    ("spec", "field", "allowed"),
    [
        ({"minMember": "three"}, 'spec.minMember: "three"', NUMBER),
        ({"minMember": 2.5}, "spec.minMember: 2.5", NUMBER),
        ({"minMember": True}, "spec.minMember: true", NUMBER),
        ({"minMember": 1 << 40}, f"spec.minMember: {1 << 40}", NUMBER),
        ({"minMember": [1] * 60}, "spec.minMember: [" + "1, " * 25 + " ...", NUMBER),
        ({"minMember": 3, "scheduleTimeoutSeconds": "soon"}, 'spec.scheduleTimeoutSeconds: "soon"', NUMBER),
        ("three", 'spec: "three"', "a mapping"),
        ({"schedulingPolicy": {"gang": 3}}, "spec.schedulingPolicy.gang: 3", "a mapping"),
        ({"schedulingPolicy": {"gang": {"minCount": "x"}}}, 'spec.schedulingPolicy.gang.minCount: "x"', NUMBER),
        ({"schedulingConstraints": {"topology": "rack"}}, 'spec.schedulingConstraints.topology: "rack"', "a list"),
    ],
)
def test_a_group_that_cannot_be_read_holds_its_pods_and_says_at_once_which_field(
    spec: Any, field: str, allowed: str
) -> None:
    core = small_nodes(3)
    group = pod_group()
    group.spec = spec
    announce(core, group)
    arrive(core, *team(3))
    assert [gate.reason for _, gate in core.held()] == [WRONG.format(field, allowed)] * 3
    assert run(core) == {}
    announce(core, pod_group(min_member=3))
    assert len(run(core)) == 3, "it was mended"


def test_pods_that_came_before_their_group_hear_at_once_that_it_cannot_be_planned() -> None:
    core = small_nodes(3)
    arrive(core, *team(3))
    assert core.held() == []
    announce(core, pod_group(min_member="three"))
    assert [gate.reason for _, gate in core.held()] == [WRONG.format('spec.minMember: "three"', NUMBER)] * 3
    announce(core, pod_group(min_member=9))
    assert core.held() == [], "an incomplete group has a minute"


@pytest.mark.parametrize(
    ("spec", "needed"),
    [(None, 0), ({}, 0), ({"minMember": None}, 0), ({"minMember": 3.0}, 3), ({"minMember": -1}, 0)],
)
def test_what_a_group_leaves_out_or_writes_in_another_way_is_no_mistake(spec: Any, needed: int) -> None:
    group = pod_group()
    group.spec = spec
    spec = understood(group).spec
    assert (spec.needed, spec.problem) == (needed, "")


def test_a_group_that_is_spoilt_when_one_of_its_pods_runs_is_whole_only_after_it_was_mended() -> None:
    core = small_nodes(4)
    announce(core, pod_group(min_member="three"))
    arrive(core, team_pod("early", cpu="1", node="n0"))
    announce(core, pod_group(min_member=4))
    arrive(core, *team(2))
    assert run(core) == {}, "three of four"


def test_a_status_nobody_can_read_counts_as_none() -> None:
    group = pod_group()
    group.status = {"phase": 7}
    assert not understood(group).was_placed
    group.status = {"phase": "Running"}
    assert understood(group).was_placed


def test_nobody_is_evicted_for_a_group_that_would_still_not_be_whole() -> None:
    core = make_core(make_node("n0", cpu="1500m"))
    core.cluster.apply_pod(make_pod("low", cpu="1", node="n0"))
    announce(core, pod_group(min_member=2))
    arrive(core, *team(2, priority=100))
    assert [decision.plan for decision in core.schedule(core.queue.pop())] == [None, None]


def test_one_is_evicted_at_a_time_for_a_group_that_becomes_whole_by_it() -> None:
    core = make_core(make_node("n0", cpu="1500m"), make_node("n1", cpu="1500m"))
    for node in ("n0", "n1"):
        core.cluster.apply_pod(make_pod(f"low-{node}", cpu="1", node=node))
    announce(core, pod_group(min_member=2))
    arrive(core, *team(2, priority=100))
    assert sum(decision.plan is not None for decision in core.schedule(core.queue.pop())) == 1


def test_a_pod_of_an_app_goes_by_its_app_and_spec_comes_before_the_label() -> None:
    assert group_ref_of(member_pod("driver", labels={POD_GROUP_LABEL: "team"})) is None
    both = make_pod("b", labels={POD_GROUP_LABEL: "x"}, schedulingGroup={"podGroupName": "y"})
    assert group_ref_of(both) == (WORKLOADS, "default", "y")
    assert group_ref_of(make_pod("c")) is None


def test_a_change_is_about_the_groups_its_object_belongs_to() -> None:
    app = app_object({"name": "driver"})
    assert groups_of(Event("robotapps", Change.APPS, None, app)) == ("app-1",)
    child = make_pod("d", labels={str(Label.APP_UID): "app-1"})
    assert groups_of(Event("pods", Change.POD_SEEN, child, None)) == ("app-1",)
    assert groups_of(Event("pods", Change.POD_SEEN, None, team_pod("p"))) == (f"{COSCHEDULING}/default/team",)
    assert groups_of(Event("pods", Change.POD_SEEN, None, make_pod("q"))) == ()
    assert f"{WORKLOADS}/default/team" in groups_of(Event("podgroups", Change.POD_GROUPS, None, pod_group()))
    assert groups_of(Event("", Change.RTT)) == ()


def test_the_index_forgets_groups_and_pods_that_are_gone() -> None:
    core = small_nodes(1)
    known = core.cluster.pod_groups
    group, pods = pod_group(), team(2)
    announce(core, group)
    arrive(core, *pods)
    assert known.missed(COSCHEDULING) is False
    depart(core, *pods)
    assert known.remove(group, COSCHEDULING) == Change.POD_GROUPS
    assert known.remove(group, COSCHEDULING) == Change.NONE
    assert repr(known) == "PodGroups(0)"
    arrive(core, *pods)
    assert known.missed(COSCHEDULING) is True
    assert known.missed(WORKLOADS) is False


def test_a_group_of_a_dump_counts_for_its_own_api_only() -> None:
    known = small_nodes(1).cluster.pod_groups
    group = pod_group()
    group.api_version = f"{COSCHEDULING}/v1alpha1"
    assert known.apply(group, WORKLOADS) == Change.NONE
    assert known.apply(group, COSCHEDULING) == Change.POD_GROUPS
    assert known.apply(group, COSCHEDULING) == Change.NONE


def relabelled(core: SchedulerCore, pod: Pod, *, group: str | None) -> Pod:
    """The watch shows the pod with another group's label, or with none."""
    labels = {POD_GROUP_LABEL: group} if group else {}
    new = msgspec.structs.replace(pod, metadata=msgspec.structs.replace(pod.metadata, labels=labels))
    change = core.cluster.apply_pod(new)
    core.queue.update(new)
    tell(core, Event("pods", change, pod, new))
    return new


def test_a_pod_that_changes_its_group_while_it_waits_is_placed_with_the_new_one() -> None:
    core = small_nodes(6)
    announce(core, pod_group("team", min_member=3))
    announce(core, pod_group("other", min_member=2))
    first, second = team(2)
    arrive(core, first, second, team_pod("q", group="other", cpu="1"))
    assert run(core) == {}
    relabelled(core, first, group="other")
    assert set(run(core)) == {"p0", "q"}
    check_queue(core.queue)
    arrive(core, *team(1, first=5))
    assert run(core) == {}, "only two of three are left"
    arrive(core, *team(1, first=6))
    assert set(run(core)) == {"p1", "p5", "p6"}


def test_a_pod_that_leaves_its_group_while_it_waits_is_placed_alone_and_counts_no_more() -> None:
    core = small_nodes(5)
    announce(core, pod_group("team", min_member=3))
    first, second = team(2)
    arrive(core, first, second)
    alone = relabelled(core, first, group=None)
    assert set(run(core)) == {"p0"}
    confirm(core, [alone])
    arrive(core, *team(1, first=5))
    assert run(core) == {}
    assert core.cluster.pod_groups.ready(GroupRef(COSCHEDULING, "default", "team")) == 2


def test_a_pod_that_joins_a_group_after_it_was_refused_alone_is_placed_with_it() -> None:
    core = small_nodes(1)
    announce(core, pod_group("team", min_member=2))
    alone = make_pod("p0", cpu="4")
    arrive(core, alone)
    assert run(core) == {}
    arrive(core, *team(1, first=1))
    relabelled(core, alone, group="team")
    assert run(core) == {}, "only one of two fits"
    large = make_node("large", cpu="8")
    tell(core, Event("nodes", core.cluster.apply_node(large), None, large))
    assert set(run(core)) == {"p0", "p1"}
    check_queue(core.queue)
