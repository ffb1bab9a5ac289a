"""The state of one component of one instance: its Deployment and pods, and what to tell the user about them."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple, Protocol

from robotapp_api.model.names import QUEUE_NAME, Annotation, Label, Reason
from robotapp_api.values.placement.given_up import GivenUp, parse_given_up
from robotapp_claims.rules.completion.endings import Ending
from robotapp_operator.plan.diff.attempts import FIRST_ATTEMPT, Attempt
from robotapp_operator.plan.diff.schedules import ScheduledRun, read_due
from robotapp_operator.plan.spec.objects import Deployment, Job, Pod, pod_spec
from robotapp_operator.plan.status.pods.pod_failures import explain_exit, explain_pods, find_last_exit, quote

MAX_COMPONENT_CHARACTERS: Final = 1024
"""Of one message; every status clips it further."""
NO_FAILURES: Final[Mapping[str, str]] = {}
MAX_RESTARTS: Final = 2**31 - 1
SERVER_LEAD_S: Final = 60
"""Servers and components of one start are made together; a minute apart means that the servers are newer."""
STOP: Final = "Stop"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ComponentView:
    """`reason` is None and `message` "" while all is well; `nodes` are those its pods are bound to."""

    name: str
    replicas: int
    ready: bool
    exists: bool
    bound: bool
    rolling: bool
    nodes: tuple[str, ...] = ()
    restarts: int = 0
    reason: Reason | None = None
    message: str = ""
    given_up: tuple[GivenUp, ...] = ()
    """What was given up when its pods were placed."""
    suspended: bool = False
    """Its spec has replicas: 0."""
    waits: bool = False
    """It is not started before others are ready (dependsOn)."""
    is_job: bool = False
    """Its program ends."""
    completed: bool = False
    """Its program has ended with exit code 0, as it should."""

    @property
    def node(self) -> str:
        return self.nodes[0] if self.nodes else ""

    @property
    def badness(self) -> int:
        """Returns 0 for ready; worst is what fails by itself, then what finds no node, perhaps because of that, then what starts."""
        if self.ready or self.suspended or self.completed:
            return 0
        return {None: 1, Reason.UNSCHEDULABLE: 2}.get(self.reason, 3)


class Part(Protocol):
    """What a view is made of: a component, or a helper."""

    @property
    def name(self) -> str: ...
    @property
    def replicas(self) -> int: ...
    @property
    def on_disconnect(self) -> str | None: ...


class HelperPart(NamedTuple):
    """A discovery server, router or master, named like `discovery-0`; several of one role stand in for each other."""

    name: str
    role: str
    image: str = ""
    replicas: int = 1
    on_disconnect: str | None = None


class HelperView(NamedTuple):
    """A helper and its state, explained as a component's is."""

    part: HelperPart
    view: ComponentView


def helper_part(deployment: Deployment) -> HelperPart | None:
    """Returns the helper that a Deployment runs, None for a component's."""
    labels = deployment.metadata.labels
    role, number = labels.get(Label.ROLE.value, ""), labels.get(Label.PART.value, "")
    if not role:
        return None
    containers = pod_spec(deployment.spec).get("containers") or [{}]
    return HelperPart(f"{role}-{number}" if number else role, role, str(containers[0].get("image", "")))


def component_view(
    component: Part,
    deployment: Deployment | None,
    pods: Sequence[Pod],
    *,
    missing: Sequence[str] = (),
    lost: Sequence[str] = (),
    barred: Collection[str] = (),
    failures: Mapping[str, str] = NO_FAILURES,
    wait: str = "",
) -> ComponentView:
    """Returns the view of a component that runs on.

    pods: those the Deployment owns, terminating and finished ones included. missing: required ConfigMaps, Secrets and keys that do not
    exist. lost: nodes of these pods that are not Ready. barred: uids of pods that no node admits. failures: by uid of a pod, why its
    containers do not start. wait: which components it waits for.
    """
    if deployment is None:
        return _view_missing(component, wait)
    live = sorted(
        (pod for pod in pods if not pod.terminal and pod.metadata.deletion_timestamp is None),
        key=lambda pod: pod.metadata.name,
    )
    replicas = deployment.replicas
    up_to_date = deployment.is_up_to_date(replicas)
    ready = up_to_date and deployment.status.ready_replicas == replicas > 0
    reason, message = (None, "") if ready else _explain_deployment(deployment, pods, live, barred)
    if missing and not ready and reason is None:  # the kubelet waits for the object and reports that in an event only
        reason, message = Reason.FAILED_CREATE, _describe_missing(missing)
    failed = [failures[pod.metadata.uid] for pod in live if failures.get(pod.metadata.uid)]
    if failed and not ready and reason is None:
        reason, message = Reason.FAILED_CREATE, failed[0]
    elif failed and reason is Reason.IMAGE_PULL:
        message = f"{message}; {failed[0]}"
    ending = [pod.spec.node_name for pod in pods if pod.metadata.deletion_timestamp and pod.spec.node_name in lost]
    if ending and not ready and component.on_disconnect == STOP:
        message = (
            f"stopped, because node {ending[0]} is not Ready (onDisconnect: Stop): the component starts again when "
            f"the node is back and its previous pod there has ended"
        )
    away = [pod.spec.node_name for pod in live if pod.spec.node_name in lost]
    if away and not ready and not message:  # nothing starts there, and what runs there cannot report it
        message = f"node {away[0]} is not Ready"
    if component.replicas == 0 and not message:
        message = "suspended (replicas: 0)"
    return ComponentView(
        name=component.name,
        replicas=replicas,
        ready=ready,
        exists=True,
        bound=0 < replicas <= len(live) and all(pod.spec.node_name for pod in live),
        rolling=not up_to_date,
        nodes=tuple(sorted({pod.spec.node_name for pod in live if pod.spec.node_name})),
        restarts=min(MAX_RESTARTS, sum(one.restart_count for pod in live for one in pod.status.container_statuses)),
        reason=reason,
        message=(message or wait)[:MAX_COMPONENT_CHARACTERS],
        given_up=_list_given_up(live),
        suspended=component.replicas == 0,
        waits=bool(wait),
    )


def job_view(
    component: Part,
    job: Job | None,
    pods: Sequence[Pod],
    *,
    missing: Sequence[str] = (),
    lost: Sequence[str] = (),
    barred: Collection[str] = (),
    failures: Mapping[str, str] = NO_FAILURES,
    wait: str = "",
    ending: Ending | None = None,
    attempt: Attempt = FIRST_ATTEMPT,
    has_schedule: bool = False,
) -> ComponentView:
    """Returns the view of a component with job: it is ready while its pod is, and when it has completed.

    ending: the end of its instance. attempt: that of its instance, or the next one, which follows because a job has
    failed. has_schedule: it is part of no attempt, so that no restart concerns it.
    """
    if has_schedule:
        attempt = FIRST_ATTEMPT
    if job is None:
        text = "" if ending is None else f"was not started, because the instance has ended ({ending.reason})"
        text = wait or text or attempt.message
        return dataclasses.replace(_view_missing(component, text), is_job=True, rolling=ending is None)
    live = [pod for pod in pods if not pod.terminal and pod.metadata.deletion_timestamp is None]
    completed, ready = job.is_complete, any(pod.is_ready for pod in live)
    is_replaced = job.state.attempt < attempt.number
    reason: Reason | None = None
    message = ""
    if job.verdict is not None and not job.is_complete and is_replaced:
        message = attempt.message
    elif job.verdict is not None:
        reason, message = _explain_end_of_job(job, pods, ending, has_schedule=has_schedule)
    elif not ready:
        reason, message = _explain_job(job, pods, live, missing=missing, lost=lost, barred=barred, failures=failures)
    queue = job.metadata.labels.get(QUEUE_NAME, "")
    if queue and job.is_suspended and job.verdict is None:
        message = f"waits in queue {queue} until kueue admits it (kubectl get workloads)"
    if component.replicas == 0 and not message:
        message = "suspended (replicas: 0)"
    nodes = {pod.spec.node_name for pod in live if pod.spec.node_name}
    return ComponentView(
        name=component.name,
        replicas=1,
        ready=ready or completed,
        exists=True,
        bound=completed or (bool(live) and all(pod.spec.node_name for pod in live)),
        rolling=False,
        nodes=tuple(sorted(nodes)) if job.verdict is None else (),
        restarts=min(MAX_RESTARTS, sum(pod.status.phase == "Failed" for pod in pods)),
        reason=reason,
        message=(message or wait or ("" if ready or completed else attempt.message))[:MAX_COMPONENT_CHARACTERS],
        given_up=_list_given_up(live),
        suspended=component.replicas == 0,
        waits=bool(wait),
        is_job=True,
        completed=completed,
    )


def _explain_job(
    job: Job,
    pods: Sequence[Pod],
    live: Sequence[Pod],
    *,
    missing: Sequence[str],
    lost: Sequence[str],
    barred: Collection[str],
    failures: Mapping[str, str],
) -> tuple[Reason | None, str]:
    """Returns why a job that has not ended is not ready, and how often its program has failed so far."""
    reason, message = explain_pods(pods, live, barred)
    texts = [failures[pod.metadata.uid] for pod in live if failures.get(pod.metadata.uid)]
    if reason is None and (missing or texts):
        reason, message = Reason.FAILED_CREATE, texts[0] if texts else _describe_missing(missing)
    lost_nodes = [pod.spec.node_name for pod in live if pod.spec.node_name in lost]
    return reason, message or (f"node {lost_nodes[0]} is not Ready" if lost_nodes else _describe_attempts(job, pods))


def scheduled_view(view: ComponentView, run: ScheduledRun, *, ending: Ending | None, suspended: bool) -> ComponentView:
    """Returns the view of a component with schedule, made from the view of its present Job.

    The component runs on, so it is ready between its runs and while one begins. After one that has failed it is not ready until the next
    one begins. A run that finds no node is no failure before it is late, so that a check each minute does not take the app's `Ready` away.
    """
    if ending is not None:
        text = view.message if run.is_under_way else f"ended with its instance ({ending.reason})"
        return dataclasses.replace(view, is_job=False, completed=False, rolling=False, message=text)
    is_late = run.is_late and view.reason is Reason.UNSCHEDULABLE
    reason = None if view.reason is Reason.UNSCHEDULABLE and not is_late else view.reason
    return dataclasses.replace(
        view,
        ready=reason is None,
        exists=run.job is not None,
        bound=not is_late,
        rolling=False,
        reason=reason,
        message=_describe_runs(view, run, suspended=suspended)[:MAX_COMPONENT_CHARACTERS],
        waits=False,
        is_job=False,
        completed=False,
    )


def _describe_runs(view: ComponentView, run: ScheduledRun, *, suspended: bool) -> str:
    """Returns the result of the last run or the state of the present one, and the next due time."""
    due_times, due = run.due_times, None if run.job is None else read_due(run.job)
    is_stopped = suspended or view.suspended
    texts = []
    if run.due_now is not None:
        texts.append(f"run of {due_times.format_time(run.due_now)} begins")
    elif due is not None and run.is_under_way:
        texts.append(f"run of {due_times.format_time(due)} is {'suspended' if is_stopped else 'under way'}")
    elif due is not None and run.is_ahead:
        texts.append(
            f"the due time {due_times.format_time(due)} on its last job is ahead of the clock and does not count"
        )
    elif due is not None:
        texts.append(f"run of {due_times.format_time(due)} {'failed' if view.reason else 'succeeded'}")
    if run.skipped is not None:
        texts.append(f"that of {due_times.format_time(run.skipped)} was skipped, because this one has not ended")
    if run.missed is not None:
        texts.append(f"{'run' if due is None else 'that'} of {due_times.format_time(run.missed)} {run.why_missed}")
    if is_stopped:
        texts.append("no runs while suspended")
    elif run.next_due is not None:
        texts.append(f"next run {due_times.format_time(run.next_due)}")
    if view.reason or (run.is_active and not is_stopped):
        texts.append(view.message)
    return "; ".join(filter(None, texts))


def _describe_missing(names: Sequence[str]) -> str:
    """Returns which ConfigMaps, Secrets and keys a component lacks, with the cure."""
    return f"{'; '.join(names)}: create it, or write optional: true"


def _explain_end_of_job(
    job: Job, pods: Sequence[Pod], ending: Ending | None, *, has_schedule: bool
) -> tuple[Reason | None, str]:
    """Returns the end of a job; for one that has failed why, and how to run it again, unless it has a schedule.

    A job that was ended with its instance has not failed by itself.
    """
    name, verdict = job.metadata.name, job.verdict
    if job.is_complete and verdict is not None:
        return None, f"completed at {verdict.last_transition_time}"
    is_cause = ending is None or ending.component == job.metadata.labels.get(Label.COMPONENT, "")
    if ending is not None and not is_cause and verdict is not None and verdict.reason == "DeadlineExceeded":
        return None, f"ended with its instance ({ending.reason})"
    why = f"{verdict.reason}: {verdict.message}" if verdict is not None else "failed"
    last = find_last_exit(pods)
    code = f", last with exit code {last.exit_code} ({last.reason}){quote(last)}" if last else ""
    if has_schedule:
        return Reason.JOB_FAILED, f"{why}{code}; see kubectl logs job/{name}"
    app = job.metadata.labels.get(Label.APP, "")
    return Reason.JOB_FAILED, (
        f"{why}{code}; see kubectl logs job/{name}; kubectl robotapp runs {app} --failed runs it again, and so does an edit of the component"
    )


def _describe_attempts(job: Job, pods: Sequence[Pod]) -> str:
    """Returns how often the program of a job has failed so far; "" for the first attempt."""
    count = sum(pod.status.phase == "Failed" for pod in pods)
    last = find_last_exit(pods)
    if not count or last is None:
        return ""
    attempts = job.spec.get("backoffLimit", 0) + 1
    return f"{count} of {attempts} attempts failed, last with exit code {last.exit_code} ({last.reason}){quote(last)}"


def _view_missing(component: Part, wait: str) -> ComponentView:
    """Returns the view of a component without a Deployment."""
    return ComponentView(
        name=component.name,
        replicas=component.replicas,
        ready=False,
        exists=False,
        bound=False,
        rolling=True,
        message=wait,
        suspended=component.replicas == 0,
        waits=bool(wait),
    )


def _list_given_up(pods: Sequence[Pod]) -> tuple[GivenUp, ...]:
    """Returns what was given up for the pods. Annotations that the scheduler does not write so count for nothing: others may write them, too."""
    wishes = []
    for pod in pods:
        text = pod.metadata.annotations.get(Annotation.FALLBACK.value, "") if pod.spec.node_name else ""
        with suppress(ValueError):
            wishes += [parse_given_up(text)] if text else []
    return tuple(wishes)


def cut_off(servers: Sequence[Pod], clients: Sequence[Pod]) -> tuple[str, ...]:
    """Returns the Deployments' pods that were made well before every discovery server there is now.

    A client keeps the address it resolved at its start; once all servers were replaced it hears of no late joiner.
    """
    born = [_created(pod) for pod in servers if not pod.terminal and pod.metadata.deletion_timestamp is None]
    if not born:
        return ()
    oldest = min(born) - timedelta(seconds=SERVER_LEAD_S)
    return tuple(
        sorted(
            pod.metadata.name
            for pod in clients
            if not pod.terminal and pod.metadata.deletion_timestamp is None and _created(pod) < oldest
        )
    )


def _created(pod: Pod) -> datetime:
    text = pod.metadata.creation_timestamp
    return datetime.fromisoformat(text) if text else datetime.max.replace(tzinfo=UTC)


def over_quota(message: str) -> bool:
    """Returns whether the API server refused an object because of the namespace's quota."""
    return "exceeded quota" in message


def _refusal_cure(message: str) -> str:
    """Returns what helps against a refusal of a pod."""
    if "violates PodSecurity" in message:
        return (
            "leave these fields out, or ask whoever runs the cluster for a namespace whose label "
            "pod-security.kubernetes.io/enforce admits them"
        )
    return "mend what the API server refuses"


def _explain_deployment(
    deployment: Deployment, pods: Sequence[Pod], live: Sequence[Pod], barred: Collection[str]
) -> tuple[Reason | None, str]:
    """Returns the most telling reason why it is not ready: refused pods, then containers, then scheduling."""
    for condition in deployment.status.conditions:
        if condition.type == "ReplicaFailure" and condition.status == "True":
            quota = over_quota(condition.message)
            cure = "raise the quota or lower the requests" if quota else _refusal_cure(condition.message)
            return (Reason.QUOTA_REFUSED if quota else Reason.FAILED_CREATE), f"{condition.message}; {cure}"
    reason, message = explain_pods(pods, live, barred)
    return (reason, message) if reason is not None else (explain_exit(live) or (None, message))
