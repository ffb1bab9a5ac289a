"""What a component's Deployment and pods say about it."""

from collections.abc import Collection
from typing import Any

import pytest
from tests.support.factories import component, make_app, make_deployment, make_pod

from robotapp_api.model.names import Annotation, Reason
from robotapp_api.values.placement.given_up import GivenUp
from robotapp_operator.plan.spec.objects import Deployment, Pod
from robotapp_operator.plan.status.components import ComponentView, component_view, cut_off


def view(deployment: Deployment | None, *pods: Pod, barred: Collection[str] = ()) -> ComponentView:
    return component_view(make_app(component("driver")).spec.components[0], deployment, pods, barred=barred)


def test_a_component_without_deployment_does_not_exist_yet() -> None:
    found = view(None)
    assert (found.exists, found.ready, found.bound, found.badness) == (False, False, False, 1)


def test_ready_needs_every_replica_of_the_newest_template() -> None:
    assert view(make_deployment(ready=1), make_pod(node="edge-1")).ready
    assert not view(make_deployment(ready=0)).ready
    assert not view(make_deployment(ready=1, updatedReplicas=0)).ready
    assert not view(make_deployment(ready=1, observedGeneration=0)).ready


def test_a_deployment_scaled_to_zero_is_not_ready() -> None:
    assert not view(make_deployment(replicas=0)).ready


def test_nodes_are_those_of_live_pods() -> None:
    gone = make_pod("old", node="edge-9", metadata={"deletionTimestamp": "2026-01-01T00:00:00Z"})
    done = make_pod("done", node="edge-8", status={"phase": "Failed"})
    found = view(make_deployment(), make_pod("new", node="edge-1"), gone, done)
    assert found.nodes == ("edge-1",)
    assert found.bound


def test_a_component_that_stops_with_its_node_tells_what_it_waits_for() -> None:
    stops = make_app(component("driver", onDisconnect="Stop")).spec.components[0]
    gone = make_pod("old", node="edge-9", metadata={"deletionTimestamp": "2026-01-01T00:00:00Z"})
    found = component_view(stops, make_deployment(), [gone, make_pod("new")], lost=["edge-9"])
    assert found.message.startswith("stopped, because node edge-9 is not Ready (onDisconnect: Stop)")
    assert (
        component_view(stops, make_deployment(), [gone], lost=[]).message == "waiting until the previous pod has ended"
    )


def test_quota_refusals_are_told_apart_from_other_refusals() -> None:
    def refused(message: str) -> ComponentView:
        condition = {"type": "ReplicaFailure", "status": "True", "reason": "FailedCreate", "message": message}
        return view(make_deployment(conditions=[condition]))

    quota = refused("pods is forbidden: exceeded quota: small, requested: pods=1")
    assert quota.reason == Reason.QUOTA_REFUSED
    assert "raise the quota" in quota.message
    assert refused("denied by policy").reason == Reason.FAILED_CREATE


@pytest.mark.parametrize("waiting", ["ErrImagePull", "ImagePullBackOff", "InvalidImageName"])
def test_image_trouble_is_named(waiting: str) -> None:
    found = view(make_deployment(), make_pod(node="edge-1", waiting=(waiting, "not found")))
    assert found.reason == Reason.IMAGE_PULL
    assert found.message.startswith(f"{waiting}: not found")
    assert found.badness == 3


def test_a_crash_loop_tells_count_and_exit_code() -> None:
    state = {"restartCount": 4, "lastState": {"terminated": {"exitCode": 139, "reason": "Error"}}}
    found = view(make_deployment(), make_pod(node="e", waiting=("CrashLoopBackOff", ""), container=state))
    assert found.reason == Reason.CRASH_LOOP
    assert "restarted 4 times, last with exit code 139 (Error)" in found.message
    assert found.restarts == 4


NOT_FOUND = (
    "failed to create containerd task: failed to create shim task: OCI runtime create failed: runc create failed: unable to start "
    'container process: error during container init: exec: "ros2": executable file not found in $PATH: unknown'
)


START_ERROR = {"exitCode": 128, "reason": "StartError", "message": NOT_FOUND}


@pytest.mark.parametrize(
    "pod",
    [
        make_pod(node="e", waiting=("RunContainerError", NOT_FOUND)),
        make_pod(
            node="e",
            waiting=("CrashLoopBackOff", "back-off 10s restarting failed container"),
            container={"lastState": {"terminated": START_ERROR}},
        ),
        make_pod(node="e", status={"containerStatuses": [{"name": "main", "state": {"terminated": START_ERROR}}]}),
    ],
    ids=["while the kubelet tries", "while it waits", "between the two"],
)
def test_a_program_that_cannot_be_started_keeps_its_reason(pod: Pod) -> None:
    found = view(make_deployment(), pod)
    assert found.reason == Reason.FAILED_CREATE
    assert found.message.startswith(
        'main cannot be started: exec: "ros2": executable file not found in $PATH; correct run, command'
    )
    assert "so write ROS programs under run, launch or args" in found.message


def test_the_last_words_of_a_container_are_shown() -> None:
    last = {"terminated": {"exitCode": 1, "reason": "Error", "message": "no such\n  device"}}
    state = {"restartCount": 1, "lastState": last}
    found = view(make_deployment(), make_pod(node="e", waiting=("CrashLoopBackOff", ""), container=state))
    assert "last with exit code 1 (Error): no such device; see kubectl logs" in found.message


def test_a_component_that_waits_for_others_says_for_whom_and_whether_it_exists_or_not() -> None:
    wait = "waits until driver is Ready (dependsOn)"
    for deployment in (None, make_deployment(replicas=0)):
        found = component_view(make_app(component("mapper")).spec.components[0], deployment, (), wait=wait)
        assert (found.ready, found.waits, found.message, found.reason) == (False, True, wait, None)


def test_a_suspended_component_is_neither_ready_nor_bad() -> None:
    found = component_view(
        make_app(component("mapper", replicas=0)).spec.components[0], make_deployment(replicas=0), ()
    )
    assert (found.ready, found.suspended, found.badness, found.message) == (False, True, 0, "suspended (replicas: 0)")


@pytest.mark.parametrize(
    ("ended", "cure"),
    [
        ({"exitCode": 0, "reason": "Completed"}, "write job: {} in it if it is to end"),
        ({"exitCode": 137, "reason": "OOMKilled"}, "raise resources.limits.memory"),
        ({"exitCode": 1, "reason": "Error"}, "see kubectl logs --previous"),
    ],
)
def test_a_crash_loop_has_the_cure_of_its_cause(ended: dict[str, Any], cure: str) -> None:
    state = {"restartCount": 1, "lastState": {"terminated": ended}}
    found = view(make_deployment(), make_pod(node="e", waiting=("CrashLoopBackOff", ""), container=state))
    assert found.reason == Reason.CRASH_LOOP
    assert found.message.endswith(cure)


def test_a_missing_config_map_is_a_failure_to_create() -> None:
    found = view(
        make_deployment(), make_pod(node="e", waiting=("CreateContainerConfigError", 'configmap "x" not found'))
    )
    assert found.reason == Reason.FAILED_CREATE


def test_an_unschedulable_pod_shows_the_schedulers_words() -> None:
    condition = {
        "type": "PodScheduled",
        "status": "False",
        "reason": "Unschedulable",
        "message": "0/5 nodes are available preemption: 0/5 nodes are available: 5 Preemption is not helpful",
    }
    found = view(make_deployment(), make_pod(status={"conditions": [condition]}))
    assert found.reason == Reason.UNSCHEDULABLE
    assert found.message == "0/5 nodes are available"
    assert not found.bound


def gated(*gates: str) -> Pod:
    condition = {"type": "PodScheduled", "status": "False", "reason": "SchedulingGated", "message": "is blocked"}
    spec: dict[str, Any] = {"schedulerName": "volcano", "schedulingGates": [{"name": gate} for gate in gates]}
    return make_pod(status={"conditions": [condition]}, **spec)


def test_a_gated_pod_names_its_gates() -> None:
    assert view(make_deployment(), gated("a.example/b", "c")).message == "waits for scheduling gates a.example/b, c"


def test_a_pod_without_gates_that_no_scheduler_has_looked_at_names_the_scheduler() -> None:
    """Seen live: the condition of a pod keeps saying "gated" until a scheduler of its name sees it."""
    found = view(make_deployment(), gated())
    assert found.reason == Reason.UNSCHEDULABLE
    assert found.message.startswith("scheduler volcano has not looked at the pod yet")


def test_a_pod_that_no_node_admits_says_so_and_names_nobody() -> None:
    pod = gated("robotics.io/domain")
    found = view(make_deployment(), pod, barred=[pod.metadata.uid])
    assert found.reason == Reason.UNSCHEDULABLE
    assert found.message.startswith("no node that it may use admits namespace default: ask whoever runs the robots")


def test_starting_is_no_failure() -> None:
    found = view(make_deployment(), make_pod(node="e", waiting=("ContainerCreating", "")))
    assert (found.reason, found.message, found.badness) == (None, "", 1)


def test_waiting_for_the_predecessor_is_said() -> None:
    old = make_pod(node="e", metadata={"deletionTimestamp": "2026-01-01T00:00:00Z"})
    assert "previous pod" in view(make_deployment(), old).message


def test_messages_are_bounded() -> None:
    assert len(view(make_deployment(), make_pod(node="e", waiting=("ErrImagePull", "x" * 5000))).message) == 1024


def born(name: str, minute: int, **meta: str) -> Pod:
    return make_pod(name, metadata={"creationTimestamp": f"2026-01-01T10:{minute:02}:00Z", **meta})


def test_a_client_older_than_every_discovery_server_must_restart() -> None:
    clients = [born("old", 0), born("new", 30), born("gone", 0, deletionTimestamp="2026-01-01T10:40:00Z")]
    assert cut_off([born("s0", 20), born("s1", 25)], clients) == ("old",)


def test_one_surviving_server_is_enough() -> None:
    assert cut_off([born("s0", 0), born("s1", 25)], [born("old", 0)]) == ()


def test_servers_and_clients_of_one_start_belong_together() -> None:
    assert cut_off([born("s0", 1), born("s1", 1)], [born("a", 0)]) == ()
    assert cut_off([], [born("a", 0)]) == ()
    assert cut_off([make_pod("unborn")], [make_pod("unborn too")]) == ()


def test_a_parameter_file_that_does_not_exist_is_named_until_the_component_is_ready() -> None:
    part = make_app(component("driver")).spec.components[0]
    missing = ("there is no ConfigMap drv",)
    waiting = component_view(part, make_deployment(), [make_pod(node="e")], missing=missing)
    assert waiting.reason == Reason.FAILED_CREATE
    assert waiting.message == "there is no ConfigMap drv: create it, or write optional: true"
    assert component_view(part, make_deployment(ready=1), [make_pod(node="e")], missing=missing).message == ""
    pulling = make_pod(node="e", waiting=("ErrImagePull", "x"))
    assert component_view(part, make_deployment(), [pulling], missing=missing).reason == Reason.IMAGE_PULL


def test_what_was_given_up_is_read_from_pods_on_nodes_and_only_in_the_form_of_the_scheduler() -> None:
    given = GivenUp((), "Robot", ("Edge",))

    def noted(text: str, node: str = "amr-1") -> ComponentView:
        return view(make_deployment(), make_pod(node=node, metadata={"annotations": {Annotation.FALLBACK.value: text}}))

    assert noted(given.text()).given_up == (given,)
    assert noted(given.text(), node="").given_up == ()
    assert noted("whatever").given_up == ()
    assert view(make_deployment(), make_pod(node="amr-1")).given_up == ()
