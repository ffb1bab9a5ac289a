"""From caches to the facts that plans and status are made of. No I/O, no decisions."""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping

from robotapp_api.claims.domain import DomainOutcome
from robotapp_api.claims.instances import Instance
from robotapp_api.claims.objects import App as ClaimsApp
from robotapp_api.claims.objects import Claim
from robotapp_api.claims.release import claims_domain, wanted_claim
from robotapp_api.claims.share import AppKey, Join, claim_to_join, owner_of
from robotapp_api.model.component import Params
from robotapp_api.model.names import Label, Reason
from robotapp_api.values.ranges import parse_ids
from robotapp_operator.cache import Cache
from robotapp_operator.plan.app import problems_of
from robotapp_operator.plan.changes import deployment_domain
from robotapp_operator.plan.components import component_view, cut_off
from robotapp_operator.plan.devices import device_trouble
from robotapp_operator.plan.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.infrastructure import DISCOVERY
from robotapp_operator.plan.instances import instances_of
from robotapp_operator.plan.latency import edge_views
from robotapp_operator.plan.objects import ConfigMap, Deployment, Pod
from robotapp_operator.plan.record import Record
from robotapp_operator.plan.template import PARAMS_FILE, ParamsFile
from robotapp_operator.plan.wish import App, Domain, wish_of
from robotapp_operator.sharing import rules_view


def wanted_instances(app: App, cache: Cache) -> tuple[Instance, ...]:
    running, claimed = cache.running_instances(app.uid), cache.claimed_instances(app.uid)
    return instances_of(app, cache.nodes, running=running, claimed=claimed)


def needs_domain(app: App) -> bool:
    return app.ros_version == 2


def cached_domain(app: App, robot: str, cache: Cache, outcome: DomainOutcome | None) -> Domain | None:
    """The instance's domain as far as caches can tell; None sends the caller to the API server.

    outcome: the last answer from there; it is trusted for shared ids (isolation Discovery) alone, which nobody claims.
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
        named = _named(owned_deployments(app, robot, cache)) if len(claims) > 1 else ()
        claim = wanted_claim(view, claims, named=named)
    if claim is None or claim.draining or claim.spec.domain is None:
        return None
    return Domain(claim.spec.domain.id, claim.name)


def _joined_claim(key: AppKey, robot: str, cache: Cache) -> Claim | None:
    owner = cache.sharing.named(key)
    if owner is None:
        return None
    deployed: dict[str, list[Deployment]] = defaultdict(list)
    for item in cache.deployments.of(owner.uid).values():
        deployed[item.metadata.labels.get(Label.INSTANCE, "")].append(item)
    named = {instance: _named(items) for instance, items in deployed.items()}
    return claim_to_join(rules_view(owner), robot, cache.claims.of(owner.uid).values(), named=named)


def _rules_view_of(key: AppKey, cache: Cache) -> ClaimsApp | None:
    app = cache.sharing.named(key)
    return rules_view(app) if app else None


def _named(deployments: Iterable[Deployment]) -> set[int]:
    return {number for item in deployments if (number := deployment_domain(item)) is not None}


def _shared_id(app: App, cache: Cache, outcome: DomainOutcome | None) -> Domain | None:
    """The id of the last answer, while the app's pool still shares it."""
    pool = cache.pools.get(app.pool)
    if pool is None or outcome is None or outcome.id not in parse_ids(pool.spec.shared_ids):
        return None
    return Domain(outcome.id)


def params_files(app: App, robot: str, cache: Cache) -> dict[str, ParamsFile]:
    """Per component with params: which key is its file, and the hash that rolls its pods."""
    found: dict[str, ParamsFile] = {}
    for component in app.spec.components:
        if component.params:
            config_map = cache.config_maps.get(f"{app.namespace}/{component.params.config_map}")
            found[component.name] = params_file(component.params, robot, config_map)
    return found


def params_file(params: Params, robot: str, config_map: ConfigMap | None) -> ParamsFile:
    """`perRobot`: the key `<robot>.yaml` when there is one. Else params.yaml, or the only key there is."""
    data: Mapping[str, str] = config_map.data if config_map else {}
    own = f"{robot}.yaml"
    if params.per_robot and robot and own in data:
        key = own
    else:
        key = next(iter(data)) if len(data) == 1 and PARAMS_FILE not in data else PARAMS_FILE
    content = data.get(key)
    return ParamsFile(key, hashlib.sha256(content.encode()).hexdigest()[:16] if content is not None else "")


def app_facts(
    record: Record,
    cache: Cache,
    *,
    outcomes: Mapping[str, DomainOutcome],
    troubles: Mapping[str, tuple[Reason, str]],
    held: Mapping[str, tuple[str, ...]],
    now: str,
    latency_rested: bool,
    bug: str = "",
) -> AppFacts | None:
    """None for an app whose spec cannot be parsed: there is nothing to compute from."""
    app = record.app
    if app is None:
        return None
    problems = problems_of(app, cache.nodes)
    instances: tuple[InstanceFacts, ...] = ()
    if not problems:
        pods = cache.pods_by_deployment(app.uid)
        instances = tuple(
            _instance_facts(
                app,
                instance,
                cache,
                pods=pods,
                outcome=outcomes.get(instance.robot),
                trouble=troubles.get(instance.robot),
                held=held.get(instance.robot, ()),
            )
            for instance in wanted_instances(app, cache)
        )
    wish = wish_of(app, "")
    return AppFacts(
        app=app,
        problems=problems,
        instances=instances,
        previous=record.status,
        now=now,
        latency_rested=latency_rested,
        rmw=wish.rmw,
        discovery=wish.discovery,
        bug=bug,
    )


def _last_joined(app: App, outcome: DomainOutcome | None) -> Domain | None:
    """What a sharer was told last, for its status alone: after a start its owner may not be in the caches yet."""
    if not app.share_with or outcome is None or outcome.id is None:
        return None
    return Domain(outcome.id, outcome.claim)


def _instance_facts(
    app: App,
    instance: Instance,
    cache: Cache,
    *,
    pods: Mapping[str, list[Pod]],
    outcome: DomainOutcome | None,
    trouble: tuple[Reason, str] | None,
    held: tuple[str, ...],
) -> InstanceFacts:
    owned = owned_deployments(app, instance.robot, cache)
    by_component = {item.metadata.labels.get(Label.COMPONENT, ""): item for item in owned}
    views = []
    for component in app.spec.components:
        deployment = by_component.get(component.name)
        mine = pods.get(deployment.metadata.uid, ()) if deployment else ()
        views.append(component_view(component, deployment, mine))
    domain = cached_domain(app, instance.robot, cache, outcome) or _last_joined(app, outcome)
    robot = cache.nodes.get(instance.node)
    placed = {view.name: view.node for view in views if view.node}
    devices = cache.devices_held(app.uid, instance.robot)
    wanted = sum(device.exclusive for component in app.spec.components for device in component.devices)
    busy = ""
    if len(devices) < wanted:
        busy = device_trouble(app, instance, claims=cache.all_claims(), telemetry=cache.telemetry, nodes=cache.nodes)
    domains = cache.domains_held(app.uid, instance.robot)
    return InstanceFacts(
        instance=instance,
        components=tuple(views),
        edges=tuple(edge_views(app.spec.edges, placed=placed, robot_node=instance.node, telemetry=cache.telemetry)),
        domain=domain.id if domain else None,
        needs_domain=needs_domain(app),
        devices_wanted=wanted,
        devices_held=len(devices),
        busy=busy,
        claims=tuple(sorted(claim.name for claim in (*domains, *devices))),
        refusal=(outcome.reason, outcome.message) if outcome and outcome.id is None and domain is None else None,
        trouble=trouble,
        held=held,
        robot_online=robot is None or robot.ready,
        infrastructure_ready=_infrastructure_ready(owned),
        cut_off=_cut_off(owned, pods),
    )


def owned_deployments(app: App, robot: str, cache: Cache) -> list[Deployment]:
    """The instance's Deployments the app controls, by name."""
    found = (
        item
        for item in cache.deployments.of(app.uid).values()
        if item.metadata.controller_uid() == app.uid and item.metadata.labels.get(Label.INSTANCE, "") == robot
    )
    return sorted(found, key=lambda item: item.metadata.name)


def _cut_off(deployments: Iterable[Deployment], pods: Mapping[str, list[Pod]]) -> tuple[str, ...]:
    servers: list[Pod] = []
    clients: list[Pod] = []
    for item in deployments:
        role = item.metadata.labels.get(Label.ROLE)
        if role in (None, DISCOVERY):
            (clients if role is None else servers).extend(pods.get(item.metadata.uid, ()))
    return cut_off(servers, clients)


def _infrastructure_ready(deployments: Iterable[Deployment]) -> bool:
    """Of several equal parts one suffices: that is what the second discovery server is for."""
    ready: dict[str, bool] = {}
    for item in deployments:
        role = item.metadata.labels.get(Label.ROLE)
        if role:
            ready[role] = ready.get(role, False) or item.status.ready_replicas > 0
    return all(ready.values())
