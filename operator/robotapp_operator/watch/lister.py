"""From caches to the facts that plans and status are made of. No I/O, no decisions.

Which instances an app has, and whether its spec is accepted, depends on all nodes, and every key of every instance needs both.
So they are computed once for each version of the spec and the nodes.
"""

import dataclasses
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from robotapp_api.model.app.component import Component
from robotapp_api.model.names import GPU, Annotation, Label, Reason
from robotapp_api.values.overrides import select_overrides
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_api.values.quantities.ranges import parse_ids
from robotapp_claims.rules.device import claimed, claims_wanted
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.identity import granted_devices, shared_devices
from robotapp_claims.rules.instances import ANY, Instance, robot_of, too_many_missing
from robotapp_claims.rules.objects import App as ClaimsApp
from robotapp_claims.rules.objects import Claim
from robotapp_claims.rules.release import claims_domain, wanted_claim
from robotapp_claims.rules.share import AppKey, Join, claim_to_join, owner_of
from robotapp_client.api.times import whole_seconds
from robotapp_operator.plan.diff.diff import deployment_domain
from robotapp_operator.plan.diff.jobs import Progress, judge_progress, list_admitted, names_domain
from robotapp_operator.plan.diff.master_restarts import plan_restarts, ros_deployments
from robotapp_operator.plan.diff.newer import Held
from robotapp_operator.plan.moves.mass_loss import Losses, losses_of
from robotapp_operator.plan.moves.move_record import NO_MOVES, SHOWN_MOVES, parse_moves
from robotapp_operator.plan.render.child import DEPLOYMENT
from robotapp_operator.plan.render.devices.ledger import describe_ledger
from robotapp_operator.plan.render.services import DISCOVERY
from robotapp_operator.plan.spec.config_content import ClusterConfig, config_content, reads_config
from robotapp_operator.plan.spec.dependencies import describe_wait, unmet_dependencies
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.instances import instances_of, matching_robots
from robotapp_operator.plan.spec.links import LinkView, list_links
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job, Node, Pod, Telemetry
from robotapp_operator.plan.spec.robot_values import overridden, recorded_overrides
from robotapp_operator.plan.spec.validate import Problem, domain_problems, name_problems, problems_alone, problems_with
from robotapp_operator.plan.status.components import (
    ComponentView,
    HelperView,
    component_view,
    cut_off,
    helper_part,
    job_view,
)
from robotapp_operator.plan.status.device_conflicts import PodDevices, device_trouble, missing_device
from robotapp_operator.plan.status.device_loss import LostDevice, is_there, lost_devices, name_of, parse_record
from robotapp_operator.plan.status.facts import Grace, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeView, edge_views
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.nodes import Lost
from robotapp_operator.watch.sharing_index import rules_view


def wanted_instances(app: App, cache: Cache) -> tuple[Instance, ...]:
    """In name order."""
    return tuple(instances_by_name(app, cache).values())


def instances_by_name(app: App, cache: Cache) -> Mapping[str, Instance]:
    """Those of robots out of sight included, as long as they go on."""
    running, claimed = cache.running_instances(app.uid), cache.claimed_instances(app.uid)
    robots = app.spec.robots
    choice = (frozenset(running), frozenset(claimed)) if robots and robots.assignment == ANY else ()
    version = (cache.nodes.identity_version, cache.nodes.readiness_version if choice else 0, choice)

    def work_out(kept: Collection[str] = ()) -> dict[str, Instance]:
        instances = instances_of(app, cache.nodes, running=running, claimed=claimed, kept=kept)
        problems = name_problems(app, (item.robot for item in instances if item.node))
        return {
            item.robot: dataclasses.replace(item, problem=problems[item.robot]) if item.robot in problems else item
            for item in instances
        }

    found: Mapping[str, Instance] = cache.answers.get(app, "instances", version if robots else (), work_out)
    if robots is None:
        return found
    kept = _kept(app, running - found.keys() - {""}, cache)
    if kept:
        found = cache.answers.get(app, "instances out of sight too", (version, kept), lambda: work_out(kept))
    return found


def admitted_instances(app: App, cache: Cache) -> frozenset[str]:
    """Returns the unfinished instances of a sweep that may run now."""

    def work_out() -> frozenset[str]:
        jobs = {name: cache.jobs.of_instance(app.uid, name).values() for name in app.sweep}
        return list_admitted(app, jobs, cache.running_instances(app.uid))

    answer: frozenset[str] = cache.answers.get(app, "admitted", cache.version_of_app(app.uid), work_out)
    return answer


def describe_turn(app: App, instance: str, cache: Cache) -> str:
    """Returns why an instance of a sweep does not begin yet, "" for one that may, or has begun, and where the spec is refused for all."""
    if app.spec.matrix is None or instance in cache.running_instances(app.uid):
        return ""
    is_refused = any(problem.reason == Reason.INVALID_SPEC for problem in problems_now(app, cache))
    if is_refused or instance in admitted_instances(app, cache):
        return ""
    return f"waits for its turn: {app.spec.matrix.parallelism} of {len(app.sweep)} instances run at once (matrix.parallelism)"


def app_of_instance(app: App, instance: Instance, cache: Cache) -> App:
    """Returns the app as its overrides make it for the instance: by the labels of the robot's primary node, and while that is
    unknown as its Deployments and Jobs were rendered, because a robot out of sight must not start anew.
    """
    if not app.spec.overrides:
        return app
    node = cache.nodes.get(instance.node)
    names = (
        select_overrides(app.spec.overrides, node.metadata.labels)
        if node is not None
        else recorded_overrides(owned_workloads(app, instance.robot, cache))
    )
    question = f"overridden by {sorted(names.items())}"
    app_of_robot: App = cache.answers.get(app, question, app.annotations, lambda: overridden(app, names))
    return app_of_robot


def chosen_overrides(app: App, cache: Cache) -> Mapping[str, object]:
    """Returns the overrides that the node of each instance chooses, those of nodes out of sight left out."""
    if not app.spec.overrides:
        return {}
    return {
        instance.robot: select_overrides(app.spec.overrides, node.metadata.labels)
        for instance in wanted_instances(app, cache)
        if (node := cache.nodes.get(instance.node)) is not None
    }


def names_config(app: App, cache: Cache) -> bool:
    """Whether the app names any ConfigMap or Secret; `app` as it is written, without overrides."""
    answer: bool = cache.answers.get(app, "names config", None, lambda: reads_config(app))
    return answer


def cluster_config_of(cache: Cache) -> ClusterConfig:
    """Returns what is known of ConfigMaps and Secrets."""
    return ClusterConfig(cache.config_maps, cache.secret_versions)


def _kept(app: App, nodeless: Collection[str], cache: Cache) -> frozenset[str]:
    """Robots out of sight whose instances go on. Only an instance that has something of the app's own can."""
    missing = frozenset[str]()
    if nodeless:
        seen: frozenset[str] = cache.answers.get(
            app,
            "robots",
            cache.nodes.identity_version,
            lambda: frozenset(map(robot_of, matching_robots(app, cache.nodes))),
        )
        missing = frozenset(robot for robot in nodeless if robot not in seen and cache.owns_something(app.uid, robot))
    return cache.sight.kept(
        app, missing, too_many=lambda: too_many_missing(cache.robots_with_something(), cache.nodes.robots)
    )


def problems_now(app: App, cache: Cache) -> tuple[Problem, ...]:
    """Why the spec cannot be run with the nodes and the pool there are."""
    alone: tuple[Problem, ...] = cache.answers.get(app, "problems alone", None, lambda: problems_alone(app))
    found: tuple[Problem, ...] = cache.answers.get(
        app, "problems with nodes", cache.nodes.identity_version, lambda: problems_with(app, cache.nodes)
    )
    pool, claims = cache.pools.get(app.pool), cache.claims.of(app.uid).values()
    unknown = [problem for problem in found if problem.reason == Reason.NO_MATCHING_ROBOT]
    if unknown and any(item.missing for item in instances_by_name(app, cache).values()):
        # Its robots are out of sight, not unknown: what runs for them still follows the user.
        found = tuple(problem for problem in found if problem not in unknown)
    return (*alone, *found, *domain_problems(app, pool, claims))


def needs_domain(app: App) -> bool:
    return app.ros_version == 2


def cached_domain(app: App, robot: str, cache: Cache, outcome: DomainOutcome | None) -> Domain | None:
    """The instance's domain as far as the caches know; None sends the caller to the API server.

    outcome: the last answer from there; it is trusted for shared ids (isolation Discovery) alone, which have no claims.
    """
    view = rules_view(app)
    key = (app.namespace, app.name)
    join = owner_of(view, lambda other: _rules_view_of(other, cache)) if app.share_with else Join(key)
    if join.owner is None:
        return None
    if join.owner != key:
        claim = _joined_claim(join.owner, robot, cache)
    elif not claims_domain(view):
        return _shared_id(app, cache, outcome)
    else:
        claims = cache.domains_held(app.uid, robot)
        named = _named(owned_workloads(app, robot, cache)) if len(claims) > 1 else ()
        claim = wanted_claim(view, claims, named=named)
    if claim is None or not claim.standing or claim.spec.domain is None:
        return None
    return Domain(claim.spec.domain.id, claim.name)


def _joined_claim(key: AppKey, robot: str, cache: Cache) -> Claim | None:
    owner = cache.sharing.named(key)
    if owner is None:
        return None
    deployments, jobs, uid = cache.deployments, cache.jobs, owner.uid
    named = {
        name: _named((*deployments.of_instance(uid, name).values(), *jobs.of_instance(uid, name).values()))
        for name in cache.running_instances(uid)
    }
    return claim_to_join(rules_view(owner), robot, cache.claims.of(owner.uid).values(), named=named)


def _rules_view_of(key: AppKey, cache: Cache) -> ClaimsApp | None:
    app = cache.sharing.named(key)
    return rules_view(app) if app else None


def _named(workloads: Iterable[Deployment | Job]) -> set[int]:
    return {number for item in workloads if names_domain(item) and (number := deployment_domain(item)) is not None}


def _shared_id(app: App, cache: Cache, outcome: DomainOutcome | None) -> Domain | None:
    """The id of the last answer, while the app's pool still shares it."""
    pool = cache.pools.get(app.pool)
    if pool is None or outcome is None or outcome.id not in parse_ids(pool.spec.shared_ids):
        return None
    return Domain(outcome.id)


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
    progress = judge_progress(app, cache.jobs.of_instance(app.uid, instance.robot).values(), now=now)
    has_ended = progress.ending is not None
    unmet = {} if has_ended else unmet_dependencies(app, owned, pods, progress.jobs)
    asks_domain = needs_domain(app) and not has_ended and not describe_turn(app, instance.robot, cache)
    sources = ComponentSources(owned, pods, cache, barred, cluster_config, unmet, progress)
    views = list(_view_components(app, instance.robot, sources))
    domain = None if has_ended else cached_domain(app, instance.robot, cache, outcome) or _last_joined(app, outcome)
    devices = cache.devices_held(app.uid, instance.robot)
    idle = {part.name for part in app.spec.components} if has_ended else {*unmet, *progress.ended}
    placed = {view.name: view.node for view in views if view.node}
    return InstanceFacts(
        instance=instance,
        components=tuple(views),
        edges=tuple(_measured(app, instance, placed, cache)),
        domain=domain.id if domain else None,
        ending=progress.ending,
        needs_domain=asks_domain,
        undecided=asks_domain and domain is None and outcome is None and not instance.problem,
        **_count_devices(app, instance, devices, cache, views, idle=idle),
        **(_ledger_facts(app, instance, views, owned, cache) if app.wants_devices else {}),
        claims=tuple(sorted(claim.name for claim in cache.claims.of_instance(app.uid, instance.robot).values())),
        refusal=(outcome.reason, outcome.message) if outcome and outcome.id is None and domain is None else None,
        trouble=trouble,
        held=held,
        robot_online=not instance.missing and cache.nodes.is_online(instance.node),
        grace=_grace(app, cache.nodes.lost(instance.node), now_s=now_s),
        offline_since=_since(cache.nodes.lost(instance.node)),
        lost=_lost_devices(devices, pods, owned, cache) if devices else (),
        moves=tuple(_moves(item) for item in owned if item.metadata.annotations.get(Annotation.MOVES)),
        stays=stays,
        device_stays=device_stays,
        config_held=config_held,
        present=tuple(sorted(name_of(claim) for claim in devices if is_there(claim, cache.telemetry))),
        infrastructure_ready=_infrastructure_ready(owned),
        helpers=tuple(_view_helpers(owned, pods, cache, barred)),
        links=_links(app, instance, placed, cache),
        cut_off=_not_restarted(ros_deployments(app, owned), pods) if app.managed_master else _cut_off(app, owned, pods),
    )


def _count_devices(
    app: App,
    instance: Instance,
    held: Collection[Claim],
    cache: Cache,
    views: Iterable[ComponentView],
    *,
    idle: Collection[str],
) -> dict[str, Any]:
    """Returns how many devices the instance wants now, and has, and who has the others.

    idle: components that are not started yet, or have ended.
    """
    begun = [part for part in app.spec.components if part.replicas and part.name not in idle]
    wanted = sum(claims_wanted(component.devices) for component in begun)
    having = min(_having(held, cache), wanted)
    is_short = having < wanted or _waits_to_share(begun, views)
    busy = _device_conflict(app, instance, cache) if is_short else ""
    return {"devices_wanted": wanted, "devices_held": having, "busy": busy}


def _links(app: App, instance: Instance, placed: Mapping[str, str], cache: Cache) -> tuple[LinkView, ...]:
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


def _grace(app: App, lost: Lost | None, *, now_s: float) -> Grace | None:
    if lost is None or now_s >= offline_s(app, lost):
        return None
    seconds = app.grace_s
    return Grace(whole_seconds(lost.since), whole_seconds(lost.since + timedelta(seconds=seconds)), seconds)


def _since(lost: Lost | None) -> str:
    return whole_seconds(lost.since) if lost else ""


def _having(claims: Iterable[Claim], cache: Cache) -> int:
    """How many of the claimed devices the instance has: a claim that waits for the next pod is none on a device that has gone."""
    return sum(claim.standing or is_there(claim, cache.telemetry) is not False for claim in claims)


def _lost_devices(
    claims: Iterable[Claim], pods: Mapping[str, list[Pod]], deployments: Iterable[Deployment], cache: Cache
) -> tuple[LostDevice, ...]:
    """Lost devices. On nodes that are not Ready only those that were lost before: their last report may be old, and the status
    shows the node's state.
    """
    recorded: dict[str, str] = {}
    for item in deployments:
        recorded |= parse_record(item.metadata.annotations.get(Annotation.LOST_DEVICES, ""))
    known = set(recorded.values())
    users = [
        pod.metadata.uid
        for mine in pods.values()
        for pod in mine
        if not pod.terminal
        and pod.metadata.deletion_timestamp is None
        and (pod.metadata.uid in known or not cache.nodes.lost(pod.spec.node_name))
    ]
    return lost_devices(claims, cache.telemetry, users=users, recorded=recorded)


def devices_of_pods(cache: Cache) -> PodDevices:
    """What pods on nodes share, and what bare pods hold alone: an app's pods hold by claims."""
    alone: defaultdict[str, set[str]] = defaultdict(set)
    shared: defaultdict[str, set[str]] = defaultdict(set)
    bare = [pod for pods in cache.bare_pods.values() for pod in pods.values() if not pod.terminal]
    for pod in bare:
        alone[pod.spec.node_name] |= granted_devices(pod.metadata.annotations)
    for pod in (*bare, *(pod for pods in cache.pods.values() for pod in pods.values() if not pod.terminal)):
        shared[pod.spec.node_name] |= shared_devices(pod.metadata.annotations)
    return PodDevices(alone=alone, shared=shared)


def device_losses(cache: Cache) -> Losses:
    """Returns those of the whole cluster, by both ledgers. A device of which the agent speaks no more is lost when its loss was recorded."""

    def lost(claim: Claim) -> bool:
        there = is_there(claim, cache.telemetry)
        return there is False or (there is None and _recorded(claim, cache))

    return losses_of((claim, lost(claim)) for claim in cache.claims_by_name.values() if claim.spec.device)


def _recorded(claim: Claim, cache: Cache) -> bool:
    deployments = cache.deployments.of_instance(claim.holder.uid, claim.holder.instance).values()
    texts = [item.metadata.annotations.get(Annotation.LOST_DEVICES, "") for item in deployments]
    return any(parse_record(text).get(claim.name) == claim.status.pod for text in texts if text)


def _moves(deployment: Deployment) -> tuple[str, tuple[str, ...]]:
    record = parse_moves(deployment.metadata.annotations, Annotation.MOVES) or NO_MOVES
    times = tuple(whole_seconds(time) for time in record.times[-SHOWN_MOVES:])
    return deployment.metadata.labels.get(Label.COMPONENT, ""), times


def offline_s(app: App, lost: Lost) -> float:
    """When an instance whose robot's node was lost counts as Offline, by the monotonic clock."""
    return lost.since_s + app.grace_s


def _last_joined(app: App, outcome: DomainOutcome | None) -> Domain | None:
    """The last known domain of a sharer, for its status alone: after a start its owner may not be in the caches yet."""
    if not app.share_with or outcome is None or outcome.id is None:
        return None
    return Domain(outcome.id, outcome.claim)


def _measured(app: App, instance: Instance, placed: Mapping[str, str], cache: Cache) -> list[EdgeView]:
    return edge_views(app.edges_in_use, placed=placed, robot_node=instance.node, round_trips=cache.round_trips)


def _waits_to_share(components: Iterable[Component], views: Iterable[ComponentView]) -> bool:
    """Returns whether a component without a node wants a device that it would share: no claim shows that it lacks one."""
    waiting = {view.name for view in views if not view.bound}
    return any(
        not claimed(device) and device.type != GPU
        for component in components
        if component.name in waiting
        for device in component.devices
    )


def _device_conflict(app: App, instance: Instance, cache: Cache) -> str:
    return device_trouble(
        app, instance, claims=cache.claims_by_name, telemetry=_in_reach(app, instance, cache), nodes=cache.nodes
    )


def _ledger_facts(
    app: App, instance: Instance, views: Iterable[ComponentView], owned: Iterable[Deployment], cache: Cache
) -> dict[str, Any]:
    """Returns how the instance's devices reach its containers, and which of them no node has."""
    placed = {view.name: view.node for view in views if view.node}
    return {
        "devices_handed_over": len(cache.devices_handed_over(app.uid, instance.robot)),
        "any_scheduler": all(_has_claim(component, app, instance, cache) for component in app.spec.components),
        "ledger_note": _describe_ledger(app, instance, owned, placed, cache),
        "missing_device": _missing_device(app, instance, [view.name for view in views if not view.bound], cache),
    }


def _has_claim(component: Component, app: App, instance: Instance, cache: Cache) -> bool:
    """Whether its own devices are in a ResourceClaim, or it wants none."""
    claims = cache.allocations.claims.of_instance(app.uid, instance.robot).values()
    name = desired_of(app, instance.robot).name_of(component.name)
    return not claims_wanted(component.devices) or name in {claim.metadata.name for claim in claims}


def _describe_ledger(
    app: App, instance: Instance, owned: Iterable[Deployment], placed: Mapping[str, str], cache: Cache
) -> str:
    drivers = cache.allocations.driver_nodes(cache.nodes)
    if not drivers.names and not cache.allocations.claims.of_instance(app.uid, instance.robot):
        return ""
    labels = {name: node.metadata.labels for name, node in _nodes_in_reach(app, instance, cache).items()}
    observed = {ChildRef(DEPLOYMENT, item.metadata.name): item for item in owned}
    return describe_ledger(desired_of(app, instance.robot), observed, drivers, labels, places=placed)


def _missing_device(app: App, instance: Instance, components: Collection[str], cache: Cache) -> str:
    if not components or not app.our_scheduler:
        return ""
    return missing_device(
        app,
        instance,
        components,
        telemetry=_in_reach(app, instance, cache),
        nodes=_nodes_in_reach(app, instance, cache),
    )


def _nodes_in_reach(app: App, instance: Instance, cache: Cache) -> Mapping[str, Node]:
    """Nodes where components with devices may run: of a fleet's robots only the instance's own."""
    if not _is_on_board(app, instance):
        return cache.nodes
    own = cache.nodes.of_robot(instance.robot)
    return {name: node for name in own if (node := cache.nodes.get(name)) is not None}


def _is_on_board(app: App, instance: Instance) -> bool:
    """Whether all components with devices stay on the instance's robot."""
    with_devices = [component for component in app.spec.components if component.devices]
    return bool(instance.robot) and all(component.runs_on == (ROBOT,) for component in with_devices)


def _in_reach(app: App, instance: Instance, cache: Cache) -> Mapping[str, Telemetry]:
    """Reports of the nodes where components with devices may run: of a fleet's robots only the instance's own."""
    if not _is_on_board(app, instance):
        return cache.telemetry
    own = cache.nodes.of_robot(instance.robot)
    return {name: cache.telemetry[name] for name in own if name in cache.telemetry}


def owned_deployments(app: App, robot: str, cache: Cache) -> list[Deployment]:
    """The instance's Deployments the app controls, by name."""
    deployments = cache.deployments.of_instance(app.uid, robot).values()
    controlled = [item for item in deployments if item.metadata.controller_uid == app.uid]
    return sorted(controlled, key=lambda item: item.metadata.name)


def owned_workloads(app: App, robot: str, cache: Cache) -> list[Deployment | Job]:
    """Returns the instance's Deployments and Jobs that the app controls."""
    jobs = cache.jobs.of_instance(app.uid, robot).values()
    return [*owned_deployments(app, robot, cache), *(job for job in jobs if job.metadata.controller_uid == app.uid)]


def _cut_off(app: App, deployments: Iterable[Deployment], pods: Mapping[str, list[Pod]]) -> tuple[str, ...]:
    by_role: defaultdict[str | None, list[Pod]] = defaultdict(list)
    for item in ros_deployments(app, deployments):
        by_role[item.metadata.labels.get(Label.ROLE)] += pods.get(item.metadata.uid, ())
    return cut_off(by_role[DISCOVERY], by_role[None])


def _not_restarted(deployments: Iterable[Deployment], pods: Mapping[str, list[Pod]]) -> tuple[str, ...]:
    """Returns pods of a ROS 1 app that their master does not have, and that the operator no longer restarts."""
    restarts = plan_restarts(deployments, pods).values()
    return tuple(sorted(name for restart in restarts for name in restart.refused))


class ComponentSources(NamedTuple):
    """What the views of an instance's components are made of.

    cluster_config: None for an app that names no ConfigMap or Secret. unmet: for which others each component waits.
    """

    deployments: Sequence[Deployment]
    pods: Mapping[str, list[Pod]]
    cache: Cache
    barred: Collection[str]
    cluster_config: ClusterConfig | None
    unmet: Mapping[str, Sequence[str]]
    progress: Progress


def _view_components(app: App, robot: str, sources: ComponentSources) -> Iterator[ComponentView]:
    """Yields the view of each component in the order of the spec."""
    cache, ending = sources.cache, sources.progress.ending
    turn = describe_turn(app, robot, cache)
    by_component = {item.metadata.labels.get(Label.COMPONENT, ""): item for item in sources.deployments}
    for component in app.spec.components:
        deployment = by_component.get(component.name)
        job = sources.progress.jobs.get(component.name)
        workload = job if component.job is not None else deployment
        wait = turn or describe_wait(app, sources.unmet.get(component.name, ()))
        own_pods = sources.pods.get(workload.metadata.uid, ()) if workload else ()
        content = config_content(component, app, robot, sources.cluster_config) if sources.cluster_config else None
        if component.job is not None:
            yield job_view(
                component,
                job,
                own_pods,
                missing=content.missing if content else (),
                lost=[pod.spec.node_name for pod in own_pods if cache.nodes.lost(pod.spec.node_name)],
                barred=sources.barred,
                failures=cache.pod_failures,
                wait=wait,
                ending=ending,
            )
            continue
        yield component_view(
            component,
            deployment,
            own_pods,
            missing=content.missing if content else (),
            lost=[pod.spec.node_name for pod in own_pods if cache.nodes.lost(pod.spec.node_name)],
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
    """Of several equal parts one suffices: that is what the second discovery server is for. One that is stopped is not waited for."""
    ready: dict[str, bool] = {}
    for item in deployments:
        role = item.metadata.labels.get(Label.ROLE)
        if role and item.replicas:
            ready[role] = ready.get(role, False) or item.status.ready_replicas > 0
    return all(ready.values())
