"""Lists an app's instances as the caches show them, with the problems of its spec and the domain of each instance. No I/O.

Which instances an app has, and whether its spec is accepted, depends on all nodes, and every key of every instance needs both.
So they are computed once for each version of the spec and the nodes.
"""

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from datetime import datetime
from typing import Any

from robotapp_api.model.names import Reason
from robotapp_api.values.overrides import select_overrides
from robotapp_api.values.quantities.ranges import parse_ids
from robotapp_api.values.sweeps.matrix import limit_domains
from robotapp_claims.rules.domain import DomainOutcome, count_available
from robotapp_claims.rules.instances import ANY, Instance, robot_of, too_many_missing
from robotapp_claims.rules.objects import App as ClaimsApp
from robotapp_claims.rules.objects import Claim
from robotapp_claims.rules.release import claims_domain, wanted_claim
from robotapp_claims.rules.share import AppKey, Join, claim_to_join, owner_of
from robotapp_operator.plan.diff.diff import deployment_domain
from robotapp_operator.plan.diff.jobs import names_domain
from robotapp_operator.plan.diff.turns import Turns, find_end_of_turn, plan_turns
from robotapp_operator.plan.render.instance_object import object_name
from robotapp_operator.plan.spec.config_content import ClusterConfig, reads_config
from robotapp_operator.plan.spec.desired import App, Domain
from robotapp_operator.plan.spec.instances import instances_of, matching_robots
from robotapp_operator.plan.spec.objects import Deployment, Job
from robotapp_operator.plan.spec.robot_values import overridden, recorded_overrides
from robotapp_operator.plan.spec.validate import Problem, domain_problems, name_problems, problems_alone, problems_with
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.sharing_index import rules_view


def wanted_instances(app: App, cache: Cache) -> tuple[Instance, ...]:
    """Returns the app's instances in name order."""
    return tuple(instances_by_name(app, cache).values())


def instances_by_name(app: App, cache: Cache) -> Mapping[str, Instance]:
    """Returns the app's instances by name, with those of robots out of sight as long as they go on."""
    running, claimed = cache.running_instances(app.uid), cache.claimed_instances(app.uid)
    robots = app.spec.robots
    choice = (frozenset(running), frozenset(claimed)) if robots and robots.assignment == ANY else ()
    version = (cache.nodes.identity_version, cache.nodes.readiness_version if choice else 0, choice)

    def list_with(kept: Collection[str] = ()) -> dict[str, Instance]:
        instances = instances_of(app, cache.nodes, running=running, claimed=claimed, kept=kept)
        problems = name_problems(app, (item.robot for item in instances if item.node))
        return {
            item.robot: dataclasses.replace(item, problem=problems[item.robot]) if item.robot in problems else item
            for item in instances
        }

    in_sight: Mapping[str, Instance] = cache.answers.get(app, "instances", version if robots else (), list_with)
    kept = frozenset[str]()
    if robots is not None:
        kept = _find_kept_robots(app, running - in_sight.keys() - {""}, cache)
    if not kept:
        return in_sight
    with_kept: Mapping[str, Instance] = cache.answers.get(
        app, "instances out of sight too", (version, kept), lambda: list_with(kept)
    )
    return with_kept


def finished_instances(app: App, cache: Cache, *, now: datetime) -> frozenset[str]:
    """Returns the instances of a sweep whose turn is over."""

    def find_ends() -> dict[str, datetime | None]:
        return {name: find_end_of_turn(app, cache.jobs.of_instance(app.uid, name).values()) for name in app.sweep}

    ends: Mapping[str, datetime | None] = cache.answers.get(
        app, "ends of turns", cache.version_of_app(app.uid), find_ends
    )
    return frozenset(name for name, end in ends.items() if end is not None and end <= now)


def admitted_instances(app: App, cache: Cache, *, now: datetime) -> frozenset[str]:
    """Returns the unfinished instances of a sweep that may run now."""
    return _plan_turns(app, cache, now=now).admitted


def _plan_turns(app: App, cache: Cache, *, now: datetime) -> Turns:
    finished, available = finished_instances(app, cache, now=now), _count_available(app, cache)

    def plan_by_claims() -> Turns:
        all_claims = cache.claims.of(app.uid).values()
        claims = [claim for claim in all_claims if claim.spec.domain and claim.spec.domain.pool == app.pool]
        holding = {claim.holder.instance for claim in claims if not claim.parked}
        parked = {claim.holder.instance for claim in claims if claim.parked}
        running = cache.running_instances(app.uid)
        return plan_turns(app, finished, running, holding=holding, parked=parked, available=available)

    version = cache.version_of_app(app.uid), available, finished
    turns: Turns = cache.answers.get(app, "turns", version, plan_by_claims)
    return turns


def _count_available(app: App, cache: Cache) -> int | None:
    """Returns how many domains of the pool the namespace of a sweep may have, None where its instances take none, or no pool is there."""
    pool = cache.pools.get(app.pool) if app.takes_domains else None
    return count_available(pool, app.namespace) if pool is not None else None


def describe_turn(app: App, instance: str, cache: Cache, *, now: datetime) -> str:
    """Returns why an instance of a sweep does not begin yet, "" for one that may, or has begun, and where the spec is refused for all."""
    if app.spec.matrix is None or instance in cache.running_instances(app.uid):
        return ""
    is_refused = any(problem.reason == Reason.INVALID_SPEC for problem in problems_now(app, cache))
    turns = _plan_turns(app, cache, now=now)
    if is_refused or instance in turns.admitted:
        return ""
    text = f"waits for its turn: {app.spec.matrix.parallelism} of {len(app.sweep)} instances run at once (matrix.parallelism)"
    if turns.available is None:
        return text
    limit = limit_domains(app.spec.matrix.parallelism, turns.available)
    if limit >= len(app.sweep):
        return text
    rest_s = cache.pools[app.pool].spec.quarantine_seconds
    text += f", with at most {limit} of {turns.available} domains, counting those of ended runs, which rest {rest_s} s"
    return f"{text}; parked until their nodes are seen again: {turns.parked}" if turns.parked else text


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
    """Returns whether the app names any ConfigMap or Secret; `app` as it is written, without overrides."""
    answer: bool = cache.answers.get(app, "names config", None, lambda: reads_config(app))
    return answer


def cluster_config_of(cache: Cache) -> ClusterConfig:
    """Returns the cached ConfigMaps and the versions of Secrets."""
    return ClusterConfig(cache.config_maps, cache.secret_versions)


def instance_status(app: App, instance: str, cache: Cache) -> Mapping[str, Any]:
    """Returns the status of the RobotAppInstance, {} without one."""
    item = cache.instance_object_named.get(f"{app.namespace}/{object_name(app.name, instance)}")
    return item.status if item is not None and item.spec.app_uid == app.uid else {}


def _find_kept_robots(app: App, nodeless: Collection[str], cache: Cache) -> frozenset[str]:
    """Returns the robots out of sight whose instances go on. Only an instance that has something of the app's own can."""
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
    """Returns why the spec cannot be run with the nodes and the pool there are."""
    alone: tuple[Problem, ...] = cache.answers.get(app, "problems alone", None, lambda: problems_alone(app))
    with_nodes: tuple[Problem, ...] = cache.answers.get(
        app, "problems with nodes", cache.nodes.identity_version, lambda: problems_with(app, cache.nodes)
    )
    pool, claims = cache.pools.get(app.pool), cache.claims.of(app.uid).values()
    unknown = [problem for problem in with_nodes if problem.reason == Reason.NO_MATCHING_ROBOT]
    if unknown and any(item.missing for item in instances_by_name(app, cache).values()):
        # Its robots are out of sight, not unknown: what runs for them still follows the user.
        with_nodes = tuple(problem for problem in with_nodes if problem not in unknown)
    return (*alone, *with_nodes, *domain_problems(app, pool, claims))


def needs_domain(app: App) -> bool:
    """Returns whether the app's instances need a domain: those of ROS 2 do."""
    return app.ros_version == 2


def cached_domain(app: App, robot: str, cache: Cache, outcome: DomainOutcome | None) -> Domain | None:
    """Returns the instance's domain as the caches show it; None sends the caller to the API server.

    outcome: the last answer from there; it is trusted for shared ids (isolation Discovery) alone, which have no claims.
    """
    view = rules_view(app)
    key = (app.namespace, app.name)
    join = owner_of(view, lambda other: _rules_view_of(other, cache)) if app.share_with else Join(key)
    if join.owner is None:
        return None
    if join.owner != key:
        claim = _find_joined_claim(join.owner, robot, cache)
    elif not claims_domain(view):
        return _find_shared_id(app, cache, outcome)
    else:
        claims = cache.domains_held(app.uid, robot)
        named = _list_ids(owned_workloads(app, robot, cache)) if len(claims) > 1 else ()
        claim = wanted_claim(view, claims, named=named)
    if claim is None or not claim.standing or claim.spec.domain is None:
        return None
    return Domain(claim.spec.domain.id, claim.name)


def _find_joined_claim(key: AppKey, robot: str, cache: Cache) -> Claim | None:
    owner = cache.sharing.named(key)
    if owner is None:
        return None
    deployments, jobs, uid = cache.deployments, cache.jobs, owner.uid
    named = {
        name: _list_ids((*deployments.of_instance(uid, name).values(), *jobs.of_instance(uid, name).values()))
        for name in cache.running_instances(uid)
    }
    return claim_to_join(rules_view(owner), robot, cache.claims.of(owner.uid).values(), named=named)


def _rules_view_of(key: AppKey, cache: Cache) -> ClaimsApp | None:
    app = cache.sharing.named(key)
    return rules_view(app) if app else None


def _list_ids(workloads: Iterable[Deployment | Job]) -> set[int]:
    """Returns the domains that templates name of which pods may still be made."""
    return {number for item in workloads if names_domain(item) and (number := deployment_domain(item)) is not None}


def _find_shared_id(app: App, cache: Cache, outcome: DomainOutcome | None) -> Domain | None:
    """Returns the id of the last answer, while the app's pool still shares it."""
    pool = cache.pools.get(app.pool)
    if pool is None or outcome is None or outcome.id not in parse_ids(pool.spec.shared_ids):
        return None
    return Domain(outcome.id)


def owned_deployments(app: App, robot: str, cache: Cache) -> list[Deployment]:
    """Returns the instance's Deployments that the app controls, in name order."""
    deployments = cache.deployments.of_instance(app.uid, robot).values()
    controlled = [item for item in deployments if item.metadata.controller_uid == app.uid]
    return sorted(controlled, key=lambda item: item.metadata.name)


def owned_workloads(app: App, robot: str, cache: Cache) -> list[Deployment | Job]:
    """Returns the instance's Deployments and Jobs that the app controls."""
    jobs = cache.jobs.of_instance(app.uid, robot).values()
    return [*owned_deployments(app, robot, cache), *(job for job in jobs if job.metadata.controller_uid == app.uid)]
