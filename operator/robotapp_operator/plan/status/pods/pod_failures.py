"""Explains why pods of a component are not ready, as their containers and the scheduler report it, with the cure."""

from collections.abc import Collection, Sequence
from typing import Final

from robotapp_api.model.names import Annotation, Reason
from robotapp_operator.plan.spec.objects import ContainerStatus, ObjectCondition, Pod, Terminated

PULLING: Final = frozenset(
    {"ErrImagePull", "ImagePullBackOff", "InvalidImageName", "ErrImageNeverPull", "RegistryUnavailable"}
)
_CONFIG: Final = frozenset({"CreateContainerConfigError", "CreateContainerError"})
_NOT_STARTED: Final = frozenset({"RunContainerError", "StartError", "ContainerCannotRun"})
"""The program could not be started at all: while the kubelet tries, in containerd's and in Docker's last state."""
_WRITE_JOB: Final = "its program ends by itself, and a component runs on: write job: {} in it if it is to end"
_RUNTIME_STEPS: Final = ("unable to start container process: ", "error during container init: ")


def explain_pods(pods: Sequence[Pod], live: Sequence[Pod], barred: Collection[str]) -> tuple[Reason | None, str]:
    """Returns why pods are not ready: containers first, then scheduling."""
    for pod in live:
        for container in (*pod.status.init_container_statuses, *pod.status.container_statuses):
            failure = _explain_container(container)
            if failure is not None:
                return failure
    for pod in live:
        if pod.metadata.uid in barred:
            return Reason.UNSCHEDULABLE, _explain_gate(pod.metadata.namespace)
        for condition in pod.status.conditions:
            if condition.type == "PodScheduled" and condition.status == "False":
                return Reason.UNSCHEDULABLE, _explain_scheduling(pod, condition)
    if not live and any(pod.metadata.deletion_timestamp for pod in pods):
        return None, "waiting until the previous pod has ended"
    return None, ""


def quote(last: Terminated | None) -> str:
    """Returns what the container itself left as its last words (terminationMessagePath), in one line."""
    words = " ".join(last.message.split()) if last else ""
    return f": {words}" if words else ""


def _describe_start_failure(name: str, message: str) -> str:
    """Returns why the container's program cannot be started, as the runtime says it, without the names of the runtime's own steps."""
    cause = message.strip()
    for step in _RUNTIME_STEPS:
        cause = cause.rpartition(step)[2]
    cause = cause.removesuffix(": unknown")
    cure = (
        "correct run, command or args, or the image; command replaces the image's entry point, which sets up ROS, so write ROS programs under "
        "run, launch or args"
        if "executable file not found" in cause or "no such file" in cause
        else "correct what it names"
    )
    return f"{name} cannot be started: {cause}; {cure}"


def _explain_gate(namespace: str) -> str:
    """Returns why a pod keeps our gate. Names neither nodes nor the namespaces that they admit: these are other tenants'."""
    return (
        f"no node that it may use admits namespace {namespace}: ask whoever runs the robots to add {namespace} to the node "
        f"annotation {Annotation.ALLOWED_NAMESPACES}, or write runsOn and nodeSelector for other nodes"
    )


def _explain_scheduling(pod: Pod, condition: ObjectCondition) -> str:
    """Returns the scheduler's message; before its first attempt, the gates or the scheduler that the pod waits for.

    The API server sets SchedulingGated when the pod is created and never removes it; the scheduler's first attempt does.
    """
    if condition.reason == "SchedulingGated":
        gates = ", ".join(gate.name for gate in pod.spec.scheduling_gates)
        if gates:
            return f"waits for scheduling gates {gates}"
        return f"scheduler {pod.spec.scheduler_name} has not looked at the pod yet: does one of that name run?"
    # The part about preemption is left to the pod's own condition.
    return condition.message.partition(" preemption: ")[0] or condition.reason


def _explain_container(container: ContainerStatus) -> tuple[Reason, str] | None:
    """Returns why a container does not run, None where its state does not tell."""
    waiting_state, final_state = container.state.waiting, container.state.terminated
    if final_state and final_state.reason in _NOT_STARTED:
        return Reason.FAILED_CREATE, _describe_start_failure(container.name, final_state.message or final_state.reason)
    if waiting_state is None:
        return None
    if waiting_state.reason in PULLING:
        return Reason.IMAGE_PULL, f"{waiting_state.reason}: {waiting_state.message}; check image and imagePullSecrets"
    if waiting_state.reason in _NOT_STARTED:
        return Reason.FAILED_CREATE, _describe_start_failure(container.name, waiting_state.message)
    if waiting_state.reason == "CrashLoopBackOff":
        return _explain_crash(container)
    if waiting_state.reason in _CONFIG:
        cure = "; create it, or write optional: true" if "not found" in waiting_state.message else ""
        return Reason.FAILED_CREATE, f"{waiting_state.reason}: {waiting_state.message}{cure}"
    return None


def _explain_crash(container: ContainerStatus) -> tuple[Reason, str]:
    """Returns why a container waits for its next start. One that never ran has no log, and keeps the reason of its first start."""
    last = container.last_state.terminated
    if last and last.reason in _NOT_STARTED:
        return Reason.FAILED_CREATE, _describe_start_failure(container.name, last.message or last.reason)
    code = f"exit code {last.exit_code} ({last.reason})" if last else "unknown exit code"
    cure = "see kubectl logs --previous"
    if last and last.reason == "OOMKilled":
        cure = "raise resources.limits.memory"
    elif last and last.exit_code == 0:
        cure = _WRITE_JOB
    text = f"{container.name} restarted {container.restart_count} times, last with {code}{quote(last)}; {cure}"
    return Reason.CRASH_LOOP, text


def explain_exit(live: Sequence[Pod]) -> tuple[Reason, str] | None:
    """Returns what is wrong where a program that should run on has ended with exit code 0, None where none has."""
    for pod in live:
        for container in pod.status.container_statuses:
            final_state = container.state.terminated
            if final_state is not None and final_state.exit_code == 0 and final_state.reason not in _NOT_STARTED:
                return (
                    Reason.PROGRAM_ENDED,
                    f"{container.name} has ended with exit code 0{quote(final_state)}; {_WRITE_JOB}",
                )
    return None


def find_last_exit(pods: Sequence[Pod]) -> Terminated | None:
    """Returns how the newest container that failed has ended."""
    failures = [
        container.state.terminated
        for pod in pods
        for container in (*pod.status.init_container_statuses, *pod.status.container_statuses)
        if container.state.terminated is not None and container.state.terminated.exit_code != 0
    ]
    return max(failures, key=lambda failure: failure.finished_at or "", default=None)
