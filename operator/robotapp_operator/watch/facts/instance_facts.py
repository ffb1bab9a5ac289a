"""Collects what the caches show of one instance: components, helpers, links, edges and devices. No I/O, no decisions."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from robotapp_api.model.names import Annotation, Label, Reason
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.diff.attempts import describe_pending
from robotapp_operator.plan.diff.jobs import Progress, judge_progress
from robotapp_operator.plan.diff.master_restarts import plan_restarts, ros_deployments
from robotapp_operator.plan.diff.newer import Held
from robotapp_operator.plan.moves.move_record import NO_MOVES, SHOWN_MOVES, parse_moves
from robotapp_operator.plan.render.services import DISCOVERY
from robotapp_operator.plan.spec.config_content import ClusterConfig, config_content
from robotapp_operator.plan.spec.dependencies import describe_wait, unmet_dependencies
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.links import LinkView, list_links
from robotapp_operator.plan.spec.objects import Deployment, Pod
from robotapp_operator.plan.status.components import (
    ComponentView,
    HelperView,
    component_view,
    cut_off,
    helper_part,
    job_view,
    scheduled_view,
)
from robotapp_operator.plan.status.device_loss import is_there, name_of
from robotapp_operator.plan.status.facts import Grace, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeView, edge_views
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.facts.device_facts import count_devices, find_lost_devices, ledger_facts
from robotapp_operator.watch.lister import (
    app_of_instance,
    cached_domain,
    cluster_config_of,
    describe_turn,
    instance_status,
    names_config,
    needs_domain,
    owned_deployments,
)
from robotapp_operator.watch.nodes import Lost


def instance_facts(
    app: App,
    instance: Instance,
    cache: Cache,
    *,
    outcome: DomainOutcome | None,
    trouble: tuple[Reason, str] | None,
    held: tuple[Held, ...],
    barred: Collection[str] = (),
    stays: str = "",
    device_stays: str = "",
    config_held: tuple[str, ...] = (),
    now_s: float,
    now: datetime,
) -> InstanceFacts:
    """Returns one instance as observed now. now_s: monotonic; barred: uids of pods that keep our gate, as no node admits them."""
    cluster_config = cluster_config_of(cache) if names_config(app, cache) else None
    app = app_of_instance(app, instance, cache)
    pods = cache.pods_by_deployment(app.uid, instance.robot)
    owned = owned_deployments(app, instance.robot, cache)
    progress = _judge_progress(app, instance.robot, cache, now=now)
    has_ended, turn = progress.ending is not None, describe_turn(app, instance.robot, cache, now=now)
    unmet = _list_unmet(app, owned, pods, progress)
    asks_domain = needs_domain(app) and not has_ended and not turn
    sources = ComponentSources(owned, pods, cache, barred, cluster_config, unmet, progress)
    views = list(_view_components(app, instance.robot, sources, turn=turn))
    domain = None if has_ended else cached_domain(app, instance.robot, cache, outcome) or _last_joined(app, outcome)
    devices = cache.devices_held(app.uid, instance.robot)
    placed = {view.name: view.node for view in views if view.node}
    return InstanceFacts(
        instance=instance,
        app_name=app.name,
        components=tuple(views),
        edges=tuple(_view_edges(app, instance, placed, cache)),
        domain=domain.id if domain else None,
        ending=progress.ending,
        changes_at=progress.find_change(now),
        attempt=progress.attempt,
        needs_domain=asks_domain,
        undecided=asks_domain and domain is None and outcome is None and not instance.problem,
        **count_devices(app, instance, devices, cache, views, idle=_list_idle(app, unmet, progress)),
        **(ledger_facts(app, instance, views, owned, cache) if app.wants_devices else {}),
        claims=tuple(sorted(claim.name for claim in cache.claims.of_instance(app.uid, instance.robot).values())),
        refusal=(outcome.reason, outcome.message) if outcome and outcome.id is None and domain is None else None,
        trouble=trouble,
        held=held,
        robot_online=not instance.missing and cache.nodes.is_online(instance.node),
        grace=_find_grace(app, cache.nodes.lost(instance.node), now_s=now_s),
        offline_since=_format_since(cache.nodes.lost(instance.node)),
        lost=find_lost_devices(devices, pods, owned, cache) if devices else (),
        moves=tuple(_read_moves(item) for item in owned if item.metadata.annotations.get(Annotation.MOVES)),
        stays=stays,
        device_stays=device_stays,
        config_held=config_held,
        present=tuple(sorted(name_of(claim) for claim in devices if is_there(claim, cache.telemetry))),
        infrastructure_ready=_infrastructure_ready(owned),
        helpers=tuple(_view_helpers(owned, pods, cache, barred)),
        links=_read_links(app, instance, placed, cache),
        cut_off=_find_cut_off(app, ros_deployments(app, owned), pods),
    )


def _read_links(app: App, instance: Instance, placed: Mapping[str, str], cache: Cache) -> tuple[LinkView, ...]:
    """Returns the addresses of the components' Services. `placed`: components and their nodes."""
    has_external = app.spec.ros2 is not None and app.spec.ros2.external is not None
    if not has_external and not app.services:
        return ()
    services = {
        service.metadata.name: service
        for service in cache.services.of_instance(app.uid, instance.robot).values()
        if service.metadata.controller_uid == app.uid
    }
    return list_links(desired_of(app, instance.robot), services, placed, cache.nodes.find_address)


def _find_grace(app: App, lost: Lost | None, *, now_s: float) -> Grace | None:
    """Returns how long the instance still counts as running although its robot's node was lost; None when it was not, or no more."""
    if lost is None or now_s >= offline_s(app, lost):
        return None
    seconds = app.grace_s
    return Grace(whole_seconds(lost.since), whole_seconds(lost.since + timedelta(seconds=seconds)), seconds)


def _format_since(lost: Lost | None) -> str:
    return whole_seconds(lost.since) if lost else ""


def _read_moves(deployment: Deployment) -> tuple[str, tuple[str, ...]]:
    record = parse_moves(deployment.metadata.annotations, Annotation.MOVES) or NO_MOVES
    times = tuple(whole_seconds(time) for time in record.times[-SHOWN_MOVES:])
    return deployment.metadata.labels.get(Label.COMPONENT, ""), times


def offline_s(app: App, lost: Lost) -> float:
    """Returns when an instance whose robot's node was lost counts as Offline, by the monotonic clock."""
    return lost.since_s + app.grace_s


def _last_joined(app: App, outcome: DomainOutcome | None) -> Domain | None:
    """Returns the last known domain of a sharer, for its status alone: after a start its owner may not be in the caches yet."""
    if not app.share_with or outcome is None or outcome.id is None:
        return None
    return Domain(outcome.id, outcome.claim)


def _view_edges(app: App, instance: Instance, placed: Mapping[str, str], cache: Cache) -> list[EdgeView]:
    return edge_views(app.edges_in_use, placed=placed, robot_node=instance.node, round_trips=cache.round_trips)


def _find_cut_off(app: App, deployments: Iterable[Deployment], pods: Mapping[str, list[Pod]]) -> tuple[str, ...]:
    """Returns the pods that their discovery servers or their master do not reach. deployments: those of the app's ROS nodes."""
    if app.managed_master:
        return _find_not_restarted(deployments, pods)
    by_role: defaultdict[str | None, list[Pod]] = defaultdict(list)
    for item in deployments:
        by_role[item.metadata.labels.get(Label.ROLE)] += pods.get(item.metadata.uid, ())
    return cut_off(by_role[DISCOVERY], by_role[None])


def _find_not_restarted(deployments: Iterable[Deployment], pods: Mapping[str, list[Pod]]) -> tuple[str, ...]:
    """Returns pods of a ROS 1 app that their master does not have, and that the operator no longer restarts."""
    restarts = plan_restarts(deployments, pods).values()
    return tuple(sorted(name for restart in restarts for name in restart.refused))


class ComponentSources(NamedTuple):
    """The objects and facts from which the views of an instance's components are made.

    cluster_config: None for an app that names no ConfigMap or Secret. unmet: the components for which each component waits.
    """

    deployments: Sequence[Deployment]
    pods: Mapping[str, list[Pod]]
    cache: Cache
    barred: Collection[str]
    cluster_config: ClusterConfig | None
    unmet: Mapping[str, Sequence[str]]
    progress: Progress


def _judge_progress(app: App, robot: str, cache: Cache, *, now: datetime) -> Progress:
    """Returns the state of the instance by its Jobs."""
    jobs = cache.jobs.of_instance(app.uid, robot).values()
    return judge_progress(app, jobs, now=now, status=instance_status(app, robot, cache))


def _list_idle(app: App, unmet: Collection[str], progress: Progress) -> set[str]:
    """Returns the components that have nothing to start now: all of them when the instance has ended."""
    return {*unmet, *progress.idle} if progress.ending is None else {part.name for part in app.spec.components}


def _list_unmet(
    app: App, deployments: Sequence[Deployment], pods: Mapping[str, Sequence[Pod]], progress: Progress
) -> dict[str, tuple[str, ...]]:
    """Returns, by component that must not start yet, the components it waits for; {} when the instance has ended."""
    if progress.ending is not None:
        return {}
    attempt = progress.attempt.number
    return unmet_dependencies(app, deployments, pods, progress.jobs, idle=progress.idle, attempt=attempt)


def _view_components(app: App, robot: str, sources: ComponentSources, *, turn: str) -> Iterator[ComponentView]:
    """Yields the view of each component in the order of the spec. turn: why the instance of a sweep does not begin yet."""
    cache, ending = sources.cache, sources.progress.ending
    by_component = {item.metadata.labels.get(Label.COMPONENT, ""): item for item in sources.deployments}
    for component in app.spec.components:
        deployment = by_component.get(component.name)
        job = sources.progress.jobs.get(component.name)
        workload = job if component.job is not None else deployment
        wait = turn or describe_wait(app, sources.unmet.get(component.name, ()))
        own_pods = sources.pods.get(workload.metadata.uid, ()) if workload else ()
        content = config_content(component, app, robot, sources.cluster_config) if sources.cluster_config else None
        missing = content.missing if content else ()
        lost_nodes = [pod.spec.node_name for pod in own_pods if cache.nodes.lost(pod.spec.node_name)]
        if component.job is not None:
            run, following = sources.progress.runs.get(component.name), sources.progress.next_attempt
            view = job_view(
                component,
                job,
                own_pods,
                missing=missing,
                lost=lost_nodes,
                barred=sources.barred,
                failures=cache.pod_failures,
                wait=wait,
                ending=ending,
                has_schedule=component.schedule is not None,
                attempt=describe_pending(following) if following else sources.progress.attempt,
            )
            yield view if run is None else scheduled_view(view, run, ending=ending, suspended=app.spec.suspend)
            continue
        yield component_view(
            component,
            deployment,
            own_pods,
            missing=missing,
            lost=lost_nodes,
            barred=sources.barred,
            failures=cache.pod_failures,
            wait=wait if ending is None else f"ended with its instance ({ending.reason})",
        )


def _view_helpers(
    deployments: Iterable[Deployment], pods: Mapping[str, list[Pod]], cache: Cache, barred: Collection[str]
) -> Iterator[HelperView]:
    """Yields discovery servers, router and master, each explained as a component is."""
    for item in deployments:
        part = helper_part(item)
        if part is not None:
            own_pods = pods.get(item.metadata.uid, ())
            lost_nodes = [pod.spec.node_name for pod in own_pods if cache.nodes.lost(pod.spec.node_name)]
            yield HelperView(
                part,
                component_view(part, item, own_pods, lost=lost_nodes, barred=barred, failures=cache.pod_failures),
            )


def _infrastructure_ready(deployments: Iterable[Deployment]) -> bool:
    """Returns whether each role of the infrastructure has a ready Deployment. One of several suffices: that is what the second discovery
    server is for. A stopped one is left out.
    """
    ready: dict[str, bool] = {}
    for item in deployments:
        role = item.metadata.labels.get(Label.ROLE)
        if role and item.replicas:
            ready[role] = ready.get(role, False) or item.status.ready_replicas > 0
    return all(ready.values())
