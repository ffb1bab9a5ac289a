"""From wanted and observed children to the writes that are missing: `plan()` is total, pure and deterministic."""

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from robotapp_api.model.names import QUEUE_NAME, Annotation, Label
from robotapp_claims.rules.identity import domain_literal
from robotapp_claims.rules.objects import ROS_DOMAIN_ID
from robotapp_operator.plan.diff.jobs import (
    NO_JOBS,
    Progress,
    amend_job,
    end_at_once,
    is_newest_of_schedule,
    limit_time,
    list_run_records,
    must_delete,
    must_replace,
)
from robotapp_operator.plan.diff.newer import (
    Held,
    amend,
    binding_rules,
    is_newer,
    restarted_spec,
    written_by_newer,
)
from robotapp_operator.plan.diff.unowned import unowned_pointers
from robotapp_operator.plan.render.child import DEPLOYMENT, JOB, SERVICE, Child
from robotapp_operator.plan.render.deployments import component_deployments, component_jobs
from robotapp_operator.plan.render.infrastructure import infrastructure
from robotapp_operator.plan.render.parameters import ParameterState
from robotapp_operator.plan.render.services import component_services, peers_service, replicas_services
from robotapp_operator.plan.spec.covers import covers
from robotapp_operator.plan.spec.dependencies import unmet_dependencies
from robotapp_operator.plan.spec.desired import App, Desired, Domain
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job, Pod, Service, pod_annotations, pod_spec

Observed = Deployment | Job | Service


@dataclasses.dataclass(frozen=True, slots=True)
class Change:
    """Write `child`: create it, or apply it over `over` (its uid and resourceVersion become preconditions)."""

    child: Child
    over: Observed | None
    amended: dict[str, Any] | None = None
    """The whole spec to write; in all else `over` stays as it is, such as a newer operator rendered it."""
    records: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Annotations that are written alone."""


@dataclasses.dataclass(frozen=True, slots=True)
class Plan:
    """`held`: children whose template is not written although it differs. `foreign`: names of objects that are not ours."""

    changes: tuple[Change, ...] = ()
    deletes: tuple[Observed, ...] = ()
    held: tuple[Held, ...] = ()
    foreign: tuple[str, ...] = ()
    awaited: frozenset[str] = frozenset()
    """Uids of those of `deletes` whose last pod is awaited, because a successor of another kind is made then."""

    def __bool__(self) -> bool:
        """Returns whether there is anything to write."""
        return bool(self.changes or self.deletes)


def wanted_children(
    desired: Desired,
    *,
    domain: Domain | None,
    parameters: Mapping[str, ParameterState],
    running: bool,
    master_starts: Mapping[str, str] = {},
    observed: Mapping[ChildRef, Observed] = {},
    pods: Mapping[str, Sequence[Pod]] | None = None,
    claiming: Collection[str] = (),
    progress: Progress = NO_JOBS,
) -> list[Child]:
    """Returns everything the instance should have, infrastructure first: it starts while the components are scheduled.

    master_starts: by component, those of the ROS 1 master for which it was restarted. claiming: components with a
    ResourceClaim. progress: the state of the instance by its Jobs. When it has ended, its Jobs are all that is left. A
    component that waits for others is not created; where it exists, it gets no pods. A ROS 2 instance without a domain
    has nothing: pods without one would all meet on domain 0.
    """
    render_jobs = functools.partial(
        component_jobs,
        desired,
        domain=domain,
        parameters=parameters,
        idle=progress.idle,
        run_times=progress.run_times,
        attempt_annotations=progress.attempt.annotations,
    )
    if progress.ending is not None:
        return [child for child in render_jobs(running=True) if child.component in progress.jobs]
    if desired.app.ros_version == 2 and domain is None:
        return []
    children = infrastructure(desired, running=running)
    if desired.app.ros_version == 2 and desired.discovery == "Peers":
        children.append(peers_service(desired))
    children += replicas_services(desired) + component_services(desired)
    waiting = unmet_dependencies(
        desired.app,
        (item for item in observed.values() if isinstance(item, Deployment)),
        pods,
        progress.jobs,
        idle=progress.idle,
        attempt=progress.attempt.number,
    )
    deployments = component_deployments(
        desired,
        domain=domain,
        parameters=parameters,
        running=running,
        master_starts=master_starts,
        waiting=waiting.keys(),
        claiming=claiming,
        attempt=progress.attempt.annotations.get(Annotation.ATTEMPT, ""),
    )
    jobs = render_jobs(running=running, waiting=waiting.keys(), claiming=claiming)
    new_jobs = {child.ref for child in jobs} - observed.keys()
    jobs = [limit_time(child, progress) if child.ref in new_jobs else child for child in jobs]
    workloads = [*deployments, *jobs]
    return [*children, *(child for child in workloads if child.component not in waiting or child.ref in observed)]


def plan(
    app: App,
    wanted: Collection[Child],
    observed: Mapping[ChildRef, Observed],
    *,
    version: str,
    settled: Mapping[str, tuple[int, str]],
    progress: Progress = NO_JOBS,
) -> Plan:
    """Returns the writes that turn `observed` into `wanted`.

    `settled`: uid -> (generation, content hash) of objects as our last apply left them. Where the server's canonical
    form differs from ours in a way `covers` does not know, this ends what would be an endless series of equal writes.
    """
    changes: list[Change] = []
    held: list[Held] = []
    waiting: list[Change] = []
    restarts: list[Change] = []
    foreign: list[str] = []
    replaced: list[Observed] = []
    changed_kind = [item for item in observed.values() if _has_changed_kind(app, item)]
    awaited_components = {item.metadata.labels.get(Label.COMPONENT, "") for item in changed_kind}
    for child in wanted:
        over = observed.get(child.ref)
        if over is None:
            if child.component not in awaited_components or child.ref.kind == SERVICE:
                changes.append(Change(child, None))
        elif over.metadata.controller_uid != app.uid:
            foreign.append(f"{child.ref.kind} {child.ref.name}")
        elif over.metadata.deletion_timestamp is not None and not isinstance(over, Service):
            continue  # its successor is made when its last pod has ended
        elif isinstance(over, Job):
            if must_replace(app, child, over, version=version) or must_delete(app, child, over, progress):
                replaced.append(over)
            elif (job_change := _change_job(app, child, over, progress)) is not None:
                changes.append(job_change)
        elif in_place(child, over, settled):
            if not _has_records(child, over) and not written_by_newer(app, over, version):
                changes.append(Change(child, over))
        elif newer := written_by_newer(app, over, version):
            amendment = amend(app, child, over)
            if amendment.spec is not None and settled.get(over.metadata.uid) != (over.metadata.generation, child.hash):
                changes.append(Change(child, over, amendment.spec))
            if amendment.waits:
                held.append(Held(child.ref.name, newer, version))
        elif is_held(app, child, over, version):
            waiting.append(Change(child, over))
            if (spec := restarted_spec(child, over)) is not None:
                restarts.append(Change(child, over, spec))
        else:
            changes.append(Change(child, over))
    moved, still = _moved_servers(waiting, changes)
    held += [Held(change.child.ref.name, ours=version) for change in still]
    names = {child.ref for child in wanted}
    unwanted = [item for ref, item in sorted(observed.items()) if ref not in names and _prunable(app, item)]
    if wanted:
        unwanted = [item for item in unwanted if not is_newest_of_schedule(item, progress)]
    deletes = [item for item in unwanted if not (wanted and _may_be_named(app, item, held, version))]
    awaited = frozenset(item.metadata.uid for item in changed_kind)
    return Plan((*moved, *changes, *restarts), (*deletes, *replaced), tuple(held), tuple(foreign), awaited)


def _has_changed_kind(app: App, item: Observed) -> bool:
    """Returns whether a Deployment's component is a job by now, or the reverse: two kinds have no rule between them that keeps a pod
    of the one from running beside a pod of the other, and not every scheduler waits for a predecessor.
    """
    if isinstance(item, Service) or item.metadata.controller_uid != app.uid:
        return False
    is_job = {component.name: component.job is not None for component in app.spec.components}
    return is_job.get(item.metadata.labels.get(Label.COMPONENT, ""), isinstance(item, Job)) != isinstance(item, Job)


def _change_job(app: App, child: Child, job: Job, progress: Progress) -> Change | None:
    """Returns what to write over a Job, None for one that stays. The spec of one that has ended stays as it is."""
    if job.verdict is None:
        spec = amend_job(app, child, job, progress) if progress.ending is None else end_at_once(job)
        if spec is not None and spec != job.spec:
            return Change(child, job, spec)
    records = list_run_records(app, child, job, progress)
    return Change(child, job, records=records) if records else None


def _moved_servers(waiting: Sequence[Change], changes: Sequence[Change]) -> tuple[list[Change], list[Change]]:
    """Returns two parts of the changes that wait for approval: infrastructure which a component that is written
    looks for at another address, and the rest.
    """
    moved: list[Change] = []
    still: list[Change] = []
    clients = any(change.child.component for change in changes)
    for change in waiting:
        is_moved = clients and not change.child.component and _host_name(change.over) != _host_name(change.child)
        (moved if is_moved else still).append(change)
    return moved, still


def _may_be_named(app: App, item: Observed, held: Sequence[Held], version: str) -> bool:
    """Returns whether a template that stays as another version rendered it may need this object, a Service or infrastructure.

    Its pods would start without discovery. The Services go with the last template that is held.
    """
    if isinstance(item, Deployment | Job) and item.metadata.labels.get(Label.COMPONENT):
        return False  # the user removed the component
    return bool(written_by_newer(app, item, version)) or (bool(held) and not isinstance(item, Deployment))


def still_running(uid: str, observed: Mapping[ChildRef, Observed]) -> list[Deployment | Job]:
    """Deployments and Jobs of the app that want pods: what a suspended app must not have, whatever else is wrong with its spec."""
    return [
        item
        for _, item in sorted(observed.items())
        if not isinstance(item, Service) and item.metadata.controller_uid == uid and _wants_pods(item)
    ]


def _wants_pods(item: Deployment | Job) -> bool:
    if isinstance(item, Job):
        return item.may_run or (item.verdict is None and QUEUE_NAME in item.metadata.labels)  # kueue resumes it
    return bool(item.spec.get("replicas", 1))


def in_place(child: Child, over: Observed, settled: Mapping[str, tuple[int, str]]) -> bool:
    """Returns whether `over` holds what `child` wants. The version that rendered it is no difference."""
    meta = over.metadata
    if meta.annotations.get(Annotation.CONTENT_HASH) != child.hash or not covers(meta.labels, child.labels):
        return False
    if settled.get(meta.uid) == (meta.generation, child.hash):
        return True  # even with a stray: a controller that puts it back at once would have us write for ever
    return covers(over.spec, child.spec) and not unowned_pointers(over.spec, child.spec)


def _has_records(child: Child, over: Observed) -> bool:
    """Returns whether what `child` records is written on `over`; it stands in annotations, so writing it starts no pod."""
    return child.annotations.items() <= over.metadata.annotations.items()


def is_held(app: App, child: Child, over: Observed, version: str) -> bool:
    """OnDemand: would only our being a newer version change the template?

    Another spec, parameters file or domain is the user's doing or the protocol's, and rolls at once.
    """
    if app.spec.update.operator != "OnDemand" or child.ref.kind != DEPLOYMENT or not isinstance(over, Deployment):
        return False
    rendered_by = over.metadata.annotations.get(Annotation.RENDERED_BY, "")
    if not is_newer(version, rendered_by) or app.annotations.get(Annotation.APPROVE_UPDATE) == version:
        return False
    marked = over.metadata.annotations.get(Annotation.SPEC_HASH)
    if marked is None:
        same = over.metadata.annotations.get(Annotation.APP_GENERATION) == str(app.generation)
    else:
        # Not the generation: an edit of another component moves that, and not this child's annotation.
        same = marked == app.spec_hashes[child.component]
    return same and _inputs(over.spec) == _inputs(child.spec)


def deployment_domain(deployment: Deployment | Job) -> int | None:
    """Returns the id that a Deployment's or Job's template names, None without one."""
    return domain_literal(template_env(deployment.spec).get(ROS_DOMAIN_ID, ""))


def template_env(spec: Mapping[str, object]) -> dict[str, str]:
    """Returns the literal variables of the first container."""
    env = next((container.get("env") for container in _containers(spec)), None)
    return {variable["name"]: variable.get("value", "") for variable in env or ()}


def _containers(spec: Mapping[str, object]) -> Sequence[Mapping[str, Any]]:
    return pod_spec(spec).get("containers") or ()


def _inputs(spec: Mapping[str, object]) -> tuple[object, ...]:
    """Returns the inputs of a template that `App.spec_hashes` leaves out, most of them from outside the spec."""
    images = [container.get("image") for container in _containers(spec)]
    return (
        template_env(spec).get(ROS_DOMAIN_ID),
        pod_annotations(spec).get(Annotation.PARAMETERS_HASH),
        pod_annotations(spec).get(Annotation.CONFIG_HASH),
        spec.get("replicas"),
        images[:1],
        binding_rules(spec),
    )


def _host_name(item: Observed | Child | None) -> tuple[object, object]:
    pod = pod_spec(item.spec if item else {})
    return pod.get("hostname"), pod.get("subdomain")


def _prunable(app: App, item: Observed) -> bool:
    """Returns whether the app controls the object and the operator made it: the owner decides, the label confirms it."""
    meta = item.metadata
    return (
        meta.controller_uid == app.uid and meta.labels.get(Label.APP_UID) == app.uid and meta.deletion_timestamp is None
    )


def ref_of(item: Observed) -> ChildRef:
    kinds = {Deployment: DEPLOYMENT, Job: JOB, Service: SERVICE}
    return ChildRef(kinds[type(item)], item.metadata.name)
