"""The pods that the operator would make of a RobotApp that is tried, and those of the app that runs under its name, which give way."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, Final, NamedTuple

import msgspec

from robotapp_api.model.names import API_VERSION, OPERATOR_MANAGER, SCHEDULER_NAME, Label
from robotapp_api.values.naming import child_name
from robotapp_api.values.placement.component_nodes import may_be_on_robot, required_nodes, robot_tolerations, tier_terms
from robotapp_api.values.replicas import expand_replicas, find_replicas
from robotapp_api.values.sweeps.matrix import expand_matrix, parallelism_of
from robotapp_claims.rules.instances import Instance, RobotSelection, instances_of, out_of_sight
from robotapp_claims.rules.objects import Meta
from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.api.robotics_v1alpha1 import ObservedStatus, RobotApp
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.pods.pod_info import Member
from robotapp_scheduler.core.robotics.app_index import App, InstanceKey, Replica
from robotapp_scheduler.what_if.question import QuestionError

MOST_PODS: Final = 500
TRIED: Final = "what-if"


class TriedApp(NamedTuple):
    """An app that is not applied: as the watch would show it, its pods, and what has to be said about them."""

    app: RobotApp
    pods: tuple[Pod, ...]
    notes: tuple[str, ...]
    kept: frozenset[str] = frozenset()
    """Robots that no node shows: what runs there goes on."""


def tried_app(
    source: Mapping[str, Any],
    nodes: Iterable[Node],
    *,
    profiles: Collection[str],
    running: App | None = None,
    robots: Collection[str] = (),
) -> TriedApp:
    """The app and its pods among these nodes. Raises QuestionError.

    profiles: names that this scheduler serves. running: the app that has this name, whose devices it goes on using; robots:
    where it has pods.
    """
    meta, where = source["metadata"], f"RobotApp {source['metadata']['namespace']}/{source['metadata']['name']}"
    uid = running.uid if running is not None else f"{TRIED}/{meta['namespace']}/{meta['name']}"
    generation = running.source.metadata.generation + 1 if running is not None else 1
    identity = {"name": meta["name"], "namespace": meta["namespace"], "uid": uid, "generation": generation}
    try:
        app = msgspec.convert({"metadata": identity, "spec": source.get("spec") or {}}, RobotApp)
        app.status = ObservedStatus(observed_generation=generation)
        if app.spec.suspend:
            return TriedApp(app, (), (f"{where} is suspended: it has no pods",))
        instances, notes = _instances(source, uid, nodes, where, robots)
        kept = frozenset(instance.robot for instance in instances if instance.missing)
        instances = [instance for instance in instances if not instance.missing]
        made = (each for instance in instances for each in _pods(source, app, instance.robot, profiles))
        pods = [msgspec.convert(each, Pod) for each in islice(made, MOST_PODS + 1)]
    except (msgspec.ValidationError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise QuestionError(
            f"{where} cannot be read: {error}; kubectl robotapp lint FILE finds what is wrong"
        ) from error
    if len(pods) > MOST_PODS:
        raise QuestionError(
            f"{where} has more than {MOST_PODS} pods on {len(instances)} robots; try it on fewer robots"
        )
    return TriedApp(app, tuple(pods), tuple(notes), kept)


def _instances(
    source: Mapping[str, Any], uid: str, nodes: Iterable[Node], where: str, running: Collection[str]
) -> tuple[list[Instance], list[str]]:
    robots, matrix = source["spec"].get("robots"), source["spec"].get("matrix")
    if matrix is not None:  # those that run first; each later one takes the place of one that has ended
        names = [instance.name for instance in expand_matrix(matrix)][: parallelism_of(matrix)]
        return [Instance(name) for name in names], []
    if robots is None:
        return [Instance()], []
    selection = RobotSelection(
        uid, source["metadata"]["namespace"], robots["nodeSelector"], robots.get("assignment", "Each")
    )
    metas = [_meta(node) for node in nodes]
    kept = out_of_sight(selection, metas, running=running)
    found = instances_of(selection, metas, running=running, claimed=(), kept=kept)
    # Its own text names the robot's nodes, which not every user may see.
    label = f"{Label.ROBOT_PRIMARY}=true"
    notes = [
        f"{where}: nothing starts on robot {each.robot} until one of its nodes is labelled {label}"
        for each in found
        if each.problem
    ]
    if not found:
        notes = [f"{where}: robots.nodeSelector names no robot that admits the namespace"]
    return [each for each in found if not each.problem], notes


def _meta(node: Node) -> Meta:
    meta = node.metadata
    return Meta(name=meta.name, uid=meta.uid, labels=dict(meta.labels or {}), annotations=dict(meta.annotations or {}))


def _pods(source: Mapping[str, Any], app: RobotApp, robot: str, profiles: Collection[str]) -> Iterator[dict[str, Any]]:
    scheduler = source["spec"].get("schedulerName") or SCHEDULER_NAME
    if scheduler not in profiles:
        raise QuestionError(
            f"RobotApp {app.metadata.name}: schedulerName {str(scheduler)[:63]!r} is none of this scheduler's: "
            + ", ".join(sorted(profiles))
        )
    home = "" if source["spec"].get("matrix") else robot
    components = expand_replicas(source["spec"])["components"]
    replicas = find_replicas(source["spec"]["components"])
    if len({component["name"] for component in components}) < len(components):
        raise QuestionError(f"RobotApp {app.metadata.name}: several components have one name")
    for component in components:
        if component.get("replicas", 1) < 0:
            raise QuestionError(f"RobotApp {app.metadata.name}: {component['name']} has a negative number of replicas")
        replica = replicas.get(component["name"])
        replica_of = replica.component if replica else ""
        for number in range(component.get("replicas", 1)):
            yield _pod(app, component, robot, number=number, replica_of=replica_of, scheduler=scheduler, home=home)


def _pod(
    app: RobotApp, component: Mapping[str, Any], robot: str, *, number: int, replica_of: str, scheduler: str, home: str
) -> dict[str, Any]:
    """Returns a pod of the instance. home: its robot, "" where it has none."""
    meta, template = app.metadata, component.get("template") or {}
    name, spec = f"{child_name(meta.name, robot, component['name'])}-{number}", template.get("spec") or {}
    own = {
        Label.APP.value: meta.name,
        Label.APP_UID.value: meta.uid,
        Label.INSTANCE.value: robot,
        Label.COMPONENT.value: component["name"],
        Label.NAME.value: replica_of or component["name"],
        **({Label.REPLICA_OF.value: replica_of} if replica_of else {}),
        Label.PART_OF.value: meta.name,
        Label.MANAGED_BY.value: OPERATOR_MANAGER,
    }
    labels = (template.get("metadata") or {}).get("labels") or {}
    owner = {"apiVersion": API_VERSION, "kind": "RobotApp", "name": meta.name, "uid": meta.uid, "controller": True}
    return {
        "metadata": {
            "name": name,
            "namespace": meta.namespace,
            "uid": f"{TRIED}/{meta.namespace}/{name}",
            "labels": labels | own,
            "ownerReferences": [owner],
        },
        "spec": {
            "schedulerName": scheduler,
            "nodeSelector": spec.get("nodeSelector") or None,
            "tolerations": _tolerations(component, spec, home),
            "affinity": _affinity(component, home),
            "hostNetwork": spec.get("hostNetwork") is True,
            "initContainers": [_container(each, spec) for each in spec.get("initContainers") or ()],
            "containers": [_container(each, spec) for each in (component, *(spec.get("containers") or ()))],
            "volumes": spec.get("volumes") or [],
        },
    }


_DECIDING: Final = ("restartPolicy", "restartPolicyRules", "volumeMounts")
"""What else the rules read of a container."""


def _container(written: Mapping[str, Any], pod: Mapping[str, Any]) -> dict[str, Any]:
    """The API server's defaults: what is not requested is requested up to its limit, and in the node's network each port is the node's."""
    resources = written.get("resources") or {}
    requests = {**(resources.get("limits") or {}), **(resources.get("requests") or {})}
    found = {"name": written.get("name", ""), "image": written.get("image", ""), "resources": {"requests": requests}}
    if ports := written.get("ports"):
        hosted = pod.get("hostNetwork") is True
        found["ports"] = [{**port, "hostPort": port["containerPort"]} if hosted else port for port in ports]
    return found | {name: written[name] for name in _DECIDING if written.get(name)}


def _tolerations(component: Mapping[str, Any], spec: Mapping[str, Any], robot: str) -> list[dict[str, Any]]:
    own = list(spec.get("tolerations") or ())
    return own + robot_tolerations(robot) if may_be_on_robot(component.get("runsOn") or (), robot) else own


def _affinity(component: Mapping[str, Any], robot: str) -> dict[str, Any] | None:
    terms = tier_terms(component.get("runsOn") or (), robot)
    return {"nodeAffinity": required_nodes(terms)} if terms else None


def running_apps(names: Collection[tuple[str, str]], cluster: Cache) -> dict[tuple[str, str], App]:
    """The apps of these namespaces and names that have a pod."""
    found = {}
    for app_uid in dict.fromkeys(app_uid for app_uid, _ in cluster.apps.instances()) if names else ():
        app = cluster.apps.app(app_uid)
        if app is not None and (key := (app.source.metadata.namespace, app.source.metadata.name)) in names:
            found[key] = app
    return found


def instances_with_pods(apps: Iterable[App], cluster: Cache) -> list[InstanceKey]:
    """The instances of these apps that have a pod."""
    uids = {app.uid for app in apps}
    return [instance for instance in cluster.apps.instances() if instance[0] in uids] if uids else []


def take_away(apps: Iterable[App], cluster: Cache) -> dict[Member, list[Replica]]:
    """Remove the pods of the apps' components, and return them. Their servers stay."""
    found: dict[Member, list[Replica]] = {}
    for app in apps:
        for instance in [each for uid, each in cluster.apps.instances() if uid == app.uid]:
            for name in app.components:
                member = Member(app.uid, instance, name)
                found[member] = cluster.apps.replicas(member, name)
                for each in found[member]:
                    cluster.remove_pod(each.pod)
    return found
