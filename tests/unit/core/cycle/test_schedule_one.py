from typing import Any

import pytest
from tests.support.scheduling import (
    default_profiles,
    device_claim,
    make_core,
    make_info,
    make_node,
    make_pod,
    telemetry,
)

from robotapp_api.model.names import SCHEDULER_NAME, Annotation, Label, PodReason
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.plugins.registry import catalogue


def test_pods_spread_over_equal_nodes_and_count_against_each_other() -> None:
    core = make_core(*(make_node(f"n{i}", cpu="1") for i in range(3)))
    placed = [core.schedule_one(make_info(f"p{i}", cpu="400m")).node for i in range(6)]
    assert sorted(str(node) for node in placed) == ["n0", "n0", "n1", "n1", "n2", "n2"]
    refused = core.schedule_one(make_info("p6", cpu="400m"))
    assert refused.message == (
        "0/3 nodes are available: 3 Insufficient cpu. "
        "preemption: 0/3 nodes are available: 3 No preemption victims found for incoming pod."
    )
    assert refused.rejected_by == {"NodeResourcesFit"}
    assert refused.reason is PodReason.UNSCHEDULABLE


def test_a_tie_is_decided_by_the_pod_and_the_seed_not_by_the_order_of_the_nodes() -> None:
    names = [f"n{i}" for i in range(7)]
    forward = make_core(*(make_node(name) for name in names))
    backward = make_core(*(make_node(name) for name in reversed(names)))
    pods = [make_info(f"p{i}") for i in range(30)]
    chosen = [forward.schedule_one(pod, assume=False).node for pod in pods]
    assert chosen == [backward.schedule_one(make_info(pod.name), assume=False).node for pod in pods]
    assert len(set(chosen)) > 3


def test_a_cluster_without_nodes_says_so() -> None:
    decision = make_core().schedule_one(make_info("p"))
    assert (decision.code, decision.message) == (Code.UNSCHEDULABLE, "no nodes available to schedule pods")
    assert decision.rejected_by == frozenset()


def test_a_node_that_is_gone_takes_no_pod_even_where_no_filter_minds_amounts() -> None:
    core = make_core(*(make_node(f"n{i}") for i in range(4)))
    few = {"multiPoint": PluginSet(enabled=(PluginRef("TaintToleration"),), disabled=(PluginRef("*"),))}
    few |= {"queueSort": PluginSet(enabled=(PluginRef("PrioritySort"),))}
    few |= {"bind": PluginSet(enabled=(PluginRef("ROSBind"),))}
    core.use(build_profiles([ProfileSpec(SCHEDULER_NAME, plugins=few)], catalogue()))
    assert core.schedule_one(make_info("first")).node is not None
    core.cluster.remove_node("n1")
    decisions = [core.schedule_one(make_info(f"p{i}"), assume=False) for i in range(20)]
    assert {decision.node for decision in decisions} == {"n0", "n2", "n3"}
    assert {decision.feasible for decision in decisions} == {3}


def test_a_pod_that_is_being_deleted_is_not_tried() -> None:
    pod = make_pod("p")
    pod.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    decision = make_core(make_node("n")).schedule_one(PodInfo(pod))
    assert decision.message == "skip schedule deleting pod: default/p"
    assert not decision.placed


def test_a_claim_that_was_not_made_yet_is_waited_for_in_upstreams_words() -> None:
    decision = make_core(make_node("n")).schedule_one(make_info("p", resourceClaims=[{"name": "camera"}]))
    assert decision.code is Code.UNRESOLVABLE
    assert decision.message.startswith('0/1 nodes are available: pod "default/p": ResourceClaim not created yet.')


@pytest.mark.parametrize(
    "spec",
    [
        {"volumes": [{"name": "v", "emptyDir": {}}, {"name": "c", "configMap": {"name": "x"}}]},
        {"topologySpreadConstraints": [{"topologyKey": "zone", "whenUnsatisfiable": "ScheduleAnyway"}]},
        {"affinity": {"podAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": []}}},
    ],
)
def test_soft_wishes_and_harmless_volumes_are_no_reason_to_refuse(spec: dict[str, Any]) -> None:
    assert make_core(make_node("n")).schedule_one(make_info("p", **spec)).placed


def test_running_pods_anti_affinity_keeps_its_domain_free_and_frees_it_again() -> None:
    core = make_core(*(make_node(f"n{i}", labels={"zone": f"z{i // 2}"}) for i in range(4)))
    term = {"topologyKey": "zone", "labelSelector": {"matchLabels": {"app": "loud"}}}
    guard = make_pod(
        "guard", node="n0",
        affinity={"podAntiAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [term]}},
    )  # fmt: skip
    loud = {"app": "loud"}
    assert core.schedule_one(make_info("before", labels=loud), assume=False).feasible == 4
    core.cluster.apply_pod(guard)
    decision = core.schedule_one(make_info("p", labels=loud), assume=False)
    assert decision.node in {"n2", "n3"}
    assert core.schedule_one(make_info("quiet", labels={"app": "quiet"}), assume=False).feasible == 4
    core.cluster.remove_pod(guard)
    assert core.schedule_one(make_info("after", labels=loud), assume=False).feasible == 4


def test_an_unreadable_amount_fails_that_pod_alone() -> None:
    core = make_core(make_node("n"))
    poison = core.schedule_one(make_info("poison", cpu="1e400e"))
    assert (poison.code, poison.reason) == (Code.ERROR, PodReason.SCHEDULER_ERROR)
    assert "1e400e" in poison.message
    assert core.schedule_one(make_info("healthy")).placed


def test_an_absurd_amount_is_refused_like_any_other_that_does_not_fit() -> None:
    decision = make_core(make_node("n")).schedule_one(make_info("p", cpu="9223372036854775807", memory="8Ei"))
    assert decision.message.startswith("0/1 nodes are available: 1 Insufficient cpu, 1 Insufficient memory.")


def test_daemon_set_pods_see_only_the_node_they_name() -> None:
    core = make_core(*(make_node(f"n{i}") for i in range(3)))
    fields = [{"key": "metadata.name", "operator": "In", "values": ["n1"]}]
    required = {"nodeSelectorTerms": [{"matchFields": fields}]}
    affinity = {"nodeAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": required}}
    assert core.schedule_one(make_info("p", affinity=affinity)).node == "n1"
    core.cluster.apply_node(make_node("n1", unschedulable=True))
    decision = core.schedule_one(make_info("q", affinity=affinity))
    assert decision.message == (
        "0/3 nodes are available: 1 node(s) were unschedulable, 2 node(s) didn't satisfy plugin(s) [NodeAffinity]. "
        "preemption: 0/3 nodes are available: 3 Preemption is not helpful for scheduling."
    )
    assert decision.rejected_by == {"NodeUnschedulable", "NodeAffinity"}


def test_preemption_is_spoken_of_in_upstreams_words() -> None:
    core = make_core(make_node("n", cpu="1"))
    core.cluster.apply_pod(make_pod("old", node="n", cpu="1", priority=0))
    vip = core.schedule_one(make_info("vip", cpu="1", priority=10))
    found = "preemption: found a potential placement for pod on node n, preempting 1 victims"
    assert vip.message == f"0/1 nodes are available: 1 Insufficient cpu. {found}"
    polite = core.schedule_one(make_info("polite", cpu="1", priority=10, preemptionPolicy="Never"))
    assert polite.message.endswith("Insufficient cpu. preemption: not eligible due to preemptionPolicy=Never.")


def test_a_node_refused_at_reserve_is_left_out_of_the_next_try_and_never_again_for_others() -> None:
    core = make_core(make_node("a"), make_node("b"))
    first = core.schedule_one(make_info("p"))
    core.cluster.forget("uid-p")
    second = core.schedule_one(make_info("p"), exclude=frozenset({str(first.node)}))
    assert {first.node, second.node} == {"a", "b"}
    core.cluster.forget("uid-p")
    third = core.schedule_one(make_info("p"), exclude=frozenset({"a", "b"}))
    assert third.message == "0/2 nodes are available: 2 node(s) lost a device to another pod."
    assert core.schedule_one(make_info("other")).placed


def test_a_malformed_annotation_holds_the_pod_with_what_is_allowed() -> None:
    core = make_core(make_node("n"))
    annotations = {str(Annotation.POLICIES): '{"latency_budget": "30"}'}
    decision = core.schedule_one(make_info("p", annotations=annotations))
    assert (decision.code, decision.reason) == (Code.UNRESOLVABLE, PodReason.INVALID_ANNOTATION)
    assert decision.message == (
        'annotation scheduler.robotics.io/policies, field latency_budget: "30" is not valid; '
        "allowed: a positive duration with a unit, such as 30ms or 1.5s"
    )
    core.queue.add(make_info("p", annotations=annotations))
    queued = core.queue.pop()[0]
    core.queue.requeue(queued, Rejection(plugins=decision.rejected_by))
    core.cluster.apply_node(make_node("m"))
    assert core.queue.move(core.cluster.apply_telemetry(telemetry("n", rtt_ms={"m": 1}))) == 0
    core.queue.update(make_pod("p", annotations={}))
    assert core.queue.pending()["unschedulable"] == 0


def test_a_profile_that_is_not_ours_is_an_error() -> None:
    decision = make_core(make_node("n")).schedule_one(make_info("p", scheduler="someone-else"))
    assert decision.code is Code.ERROR


def test_no_number_is_told_for_a_node_that_refuses_because_of_pods_promised_there() -> None:
    core = make_core(make_node("full", cpu="1"), make_node("free", cpu="4"))
    core.cluster.apply_pod(make_pod("old", node="full", cpu="900m"))
    core.schedule_one(make_info("before", cpu="500m"))  # from here on the filter has measured something
    core.cluster.nominations.nominate(make_info("first", cpu="4", priority=10), "free")
    decision = core.schedule_one(make_info("p", cpu="500m"))
    assert not decision.placed
    record = core.explain.find("default", "p")
    assert record is not None
    (refusal,) = record.refusals
    assert refusal.unit == "free"
    assert {each.node: each.number for each in refusal.examples} == {"full": 100.0, "free": None}


def test_the_explain_record_holds_refusals_numbers_top_scores_and_runner_up() -> None:
    core = make_core(
        make_node("full", cpu="1"), *(make_node(f"n{i}", cpu=str(8 + i), memory="64Gi") for i in range(14))
    )
    core.cluster.apply_pod(make_pod("old", node="full", cpu="900m"))
    decision = core.schedule_one(make_info("p", cpu="500m"), attempt=3)
    record = core.explain.find("default", "p")
    assert record is not None
    assert (record.node, record.attempt, record.nodes, record.feasible) == (decision.node, 3, 15, 14)
    (refusal,) = record.refusals
    assert (refusal.plugin, refusal.reason, refusal.nodes) == ("NodeResourcesFit", "Insufficient cpu", 1)
    assert (refusal.examples[0].node, refusal.examples[0].number, refusal.unit) == ("full", 100.0, "free")
    assert len(record.top.nodes) == 10
    assert record.top.nodes[0] == decision.node
    assert list(record.top.totals) == sorted(record.top.totals, reverse=True)
    assert record.runner_up == record.top.nodes[1]
    for i, total in enumerate(record.top.totals):
        assert total == sum(record.top.weights[name] * scores[i] for name, scores in record.top.scores.items())


def test_devices_are_granted_with_the_node_and_kept_from_the_next_pod() -> None:
    core = make_core(make_node("a"), make_node("b"))
    for node in ("a", "b"):
        core.cluster.apply_telemetry(telemetry(node, devices=[{"id": "can-can0", "type": "can", "interface": "can0"}]))
    annotations = {str(Annotation.AFFINITY): '{"hardware_requirements": [{"type": "can", "interface": "can0"}]}'}
    nodes = set()
    for name in ("p", "q"):
        decision = core.schedule_one(make_info(name, annotations=annotations))
        assert [(grant.node, grant.device.id, grant.exclusive) for grant in decision.grants] == [
            (decision.node, "can-can0", True)
        ]
        nodes.add(decision.node)
    assert nodes == {"a", "b"}
    refused = core.schedule_one(make_info("r", annotations=annotations))
    assert refused.message.startswith("0/2 nodes are available: 2 node(s) had no free device for the pod.")
    assert refused.rejected_by == {"ROSReserve"}
    core.cluster.forget("uid-p")
    assert core.schedule_one(make_info("r", annotations=annotations)).placed


def test_without_the_plugin_that_claims_them_no_devices_are_chosen() -> None:
    without = {"reserve": PluginSet(disabled=(PluginRef("ROSReserve"),))}
    core = make_core(make_node("a"))
    core.use(default_profiles([ProfileSpec(SCHEDULER_NAME, plugins=without)]))
    core.cluster.apply_telemetry(telemetry("a", devices=[{"id": "can-can0", "type": "can", "interface": "can0"}]))
    annotations = {str(Annotation.AFFINITY): '{"hardware_requirements": [{"type": "can", "interface": "can0"}]}'}
    for name in ("p", "q"):
        decision = core.schedule_one(make_info(name, annotations=annotations))
        assert (decision.node, decision.grants) == ("a", ())


@pytest.mark.parametrize(
    ("plugins", "missing"),
    [
        ({"reserve": PluginSet(disabled=(PluginRef("*"),))}, "ROSReserve at reserve"),
        (
            {"multiPoint": PluginSet(disabled=(PluginRef("ROSReserve"),))},
            "ROSReserve at reserve and ROSReserve at postBind",
        ),
        ({"postBind": PluginSet(disabled=(PluginRef("*"),))}, "ROSReserve at postBind"),
        ({"multiPoint": PluginSet(enabled=(PluginRef("DefaultBinder"),))}, "ROSBind at bind"),
        (
            {
                "bind": PluginSet(enabled=(PluginRef("DefaultBinder"),), disabled=(PluginRef("*"),)),
                "reserve": PluginSet(disabled=(PluginRef("*"),)),
            },
            "ROSReserve at reserve and ROSBind at bind",
        ),
    ],
)
def test_pods_of_apps_wait_for_a_profile_that_checks_their_domain_and_others_do_not(
    plugins: dict[str, PluginSet], missing: str
) -> None:
    core = make_core(make_node("a"))
    core.use(default_profiles([ProfileSpec(SCHEDULER_NAME, plugins=plugins)]))
    refused = core.schedule_one(make_info("p", labels={str(Label.APP_UID): "app-1"}))
    assert refused.message == (
        f"profile '{SCHEDULER_NAME}' cannot place pods of a RobotApp, because nothing in it checks or hands out their domains "
        f"and devices: enable {missing} in the scheduler's configuration"
    )
    assert (refused.node, refused.reason, len(refused.rejected_by)) == (None, PodReason.UNSCHEDULABLE, 1)
    assert core.schedule_one(make_info("q")).node == "a"


def test_a_claim_of_somebody_else_makes_another_node_win_at_once() -> None:
    core = make_core(make_node("a"), make_node("b"))
    for node in ("a", "b"):
        core.cluster.apply_telemetry(telemetry(node, devices=[{"id": "usb-cam", "type": "usb"}]))
    annotations = {str(Annotation.AFFINITY): '{"hardware_requirements": [{"type": "usb"}]}'}
    core.cluster.apply_claim(device_claim("a", "usb-cam", uid="stranger", pod="x"))
    assert core.schedule_one(make_info("p", annotations=annotations), assume=False).node == "b"
    core.cluster.apply_claim(device_claim("b", "usb-cam", uid="stranger", pod="y"))
    assert not core.schedule_one(make_info("p", annotations=annotations), assume=False).placed
    core.cluster.remove_claim(device_claim("a", "usb-cam", uid="stranger"))
    assert core.schedule_one(make_info("p", annotations=annotations), assume=False).node == "a"


def test_other_profiles_decide_from_the_next_cycle_on_and_what_was_counted_stays_counted() -> None:
    core = make_core(make_node("small", cpu="2"), make_node("large", cpu="8"))
    assert core.schedule_one(make_info("p"), assume=False).node == "large"
    before = core.decisions()
    packed = {"NodeResourcesFit": {"scoringStrategy": {"type": "MostAllocated", "resources": [{"name": "cpu"}]}}}
    off = PluginSet(disabled=(PluginRef("NodeResourcesBalancedAllocation"),))
    spec = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": off}, plugin_config=packed)
    core.swap(default_profiles([spec]), initial_backoff_s=1.0, max_backoff_s=10.0)
    assert core.decisions() == before
    assert core.schedule_one(make_info("q"), assume=False).node == "small"
    record = core.explain.get("uid-q")
    old = core.explain.get("uid-p")
    assert record is not None
    assert old is not None
    assert record.config_hash != old.config_hash
    assert "NodeResourcesBalancedAllocation" not in record.top.scores
    after = core.decisions()
    assert all(after[key] >= count for key, count in before.items())
