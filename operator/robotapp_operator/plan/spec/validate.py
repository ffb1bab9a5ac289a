"""Is the spec understood? What admission cannot decide becomes `Accepted=False` with the field, the reason and the cure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from robotapp_api.checks.containers import STOP_SIGNAL
from robotapp_api.checks.edges import bandwidth_field
from robotapp_api.checks.host_access.guarded import host_access_problems
from robotapp_api.checks.problem import Problem
from robotapp_api.checks.spec import pool_notes, spec_notes, spec_problems
from robotapp_api.model.app.component import Component
from robotapp_api.model.names import Annotation, Label, Reason
from robotapp_api.values.component_references import (
    ExpandedText,
    expanded_problem,
    list_expanded_texts,
    list_helper_texts,
)
from robotapp_api.values.overrides import merge_component, select_overrides
from robotapp_api.values.references import has_reference, reference_values
from robotapp_claims.rules.domain import DomainRequest, count_available, withheld
from robotapp_claims.rules.identity import holder_of_app
from robotapp_claims.rules.instances import closed_nodes, robot_of
from robotapp_claims.rules.objects import Claim, Pool
from robotapp_operator.plan.spec.config_content import list_secrets
from robotapp_operator.plan.spec.desired import NEVER, App
from robotapp_operator.plan.spec.instances import allowed_robots, open_robots
from robotapp_operator.plan.spec.objects import Node
from robotapp_operator.plan.spec.text import shown

__all__ = [
    "Problem",
    "decisive_robots",
    "domain_problems",
    "limit_note",
    "name_problems",
    "notes_of",
    "override_notes",
    "problems_alone",
    "problems_with",
    "secret_notes",
]


def problems_alone(app: App) -> tuple[Problem, ...]:
    """Problems of the spec alone, whatever nodes there are."""
    problems = spec_problems(app.written)
    if app.abilities.stop_signals:
        problems = (problem for problem in problems if not problem.field.endswith(STOP_SIGNAL))
    guarded = () if app.abilities.host_access else host_access_problems(app.written)
    return (*problems, *guarded)


def problems_with(app: App, nodes: Mapping[str, Node]) -> tuple[Problem, ...]:
    """Problems of the spec that depend on the current nodes."""
    return tuple(_placement_problems(app, nodes))


def domain_problems(app: App, pool: Pool | None, claims: Iterable[Claim]) -> tuple[Problem, ...]:
    """The domain that the spec requests is one its pool does not give away. claims: the app's, of all instances.

    Not for an app that holds the id already, which keeps it, nor for one that joins the domain of another.
    """
    number, ros2 = app.requested_domain, app.spec.ros2
    if pool is None or number is None or ros2 is None or ros2.isolation == "Discovery" or app.share_with:
        return ()
    things = (claim.spec.domain for claim in claims)
    if any((thing.pool, thing.id) == (app.pool, number) for thing in things if thing):
        return ()
    holder = holder_of_app(namespace=app.namespace, name=app.name, uid=app.uid)
    request = DomainRequest(holder, pool=app.pool, requested_id=number, allow_unsafe=ros2.allow_unsafe_domain)
    refused = withheld(request, pool)
    if refused is None:
        return ()
    return (Problem(refused.reason, "spec.ros2.domain", refused.message, of_cluster=number in pool.spec.reserved),)


def notes_of(app: App, pool: Pool | None = None) -> tuple[str, ...]:
    """What of an accepted spec and of its pool has no effect yet, a sentence each."""
    found = [*map(str, spec_notes(app.written, our_scheduler=app.our_scheduler)), *_of_other_schedulers(app)]
    if pool is not None and (note := limit_note(pool)):
        found.append(note)
    if pool is not None and (note := _sweep_note(app, pool)):
        found.append(note)
    if app.unknown_fields:
        found.append(
            f"{', '.join(app.unknown_fields)}: without effect, because this operator is older than the CRD that has "
            f"{'it' if len(app.unknown_fields) == 1 else 'them'}: run the operator of that version, or remove what you wrote there"
        )
    return tuple(found)


def _sweep_note(app: App, pool: Pool) -> str:
    """Returns that fewer instances of a sweep run at once than are to, because each takes a domain; "" where all have one."""
    if app.spec.matrix is None or not app.takes_domains:
        return ""
    limit = count_available(pool, app.namespace)
    count = min(app.spec.matrix.parallelism, len(app.sweep))
    if count <= limit:
        return ""
    return (
        f"spec.matrix.parallelism: {count} instances at once take a domain each, and DomainPool {pool.metadata.name} has {limit} for namespace "
        f"{app.namespace}, so the others wait until one is free; write parallelism: {max(1, limit)}, or ask for a larger pool or quota"
    )


def _of_other_schedulers(app: App) -> Iterator[str]:
    """Wishes that our scheduler alone carries out."""
    if not app.our_scheduler and app.spec.placement.reschedule.when != NEVER:
        yield (
            f"spec.placement.reschedule.when: {app.spec.placement.reschedule.when} has no effect with scheduler "
            f"{app.scheduler_name}, which proposes no better node"
        )
    if not app.our_scheduler and app.spec.placement.fallback is not None:
        yield (
            f"spec.placement.fallback: has no effect with scheduler {app.scheduler_name}, which knows no latency budgets"
        )
    if not app.our_scheduler and app.spec.placement.objective != "Latency":
        yield (
            f"spec.placement.objective: {app.spec.placement.objective} has no effect with scheduler {app.scheduler_name}, "
            "which places the pods of an app one by one"
        )
    field = bandwidth_field(app.written.edges)
    if field and not app.our_scheduler:
        yield f"{field}: has no effect with scheduler {app.scheduler_name}, which knows nothing of access links"
    for index, component in enumerate(() if app.our_scheduler else app.written.components):
        if component.on_disconnect == "Stop":
            yield (
                f"spec.components[{index}].onDisconnect: Stop acts like Failover with scheduler {app.scheduler_name}, which "
                "does not wait for a pod on a lost node to end; write Keep"
            )
        if any(device.on_loss != "Keep" for device in component.devices):
            yield (
                f"spec.components[{index}].devices: onLoss has no effect with scheduler {app.scheduler_name}, which claims no "
                "devices"
            )


def override_notes(app: App, nodes: Mapping[str, Node]) -> tuple[str, ...]:
    """Returns a sentence for each override that chooses none of the app's robots."""
    if not app.spec.overrides:
        return ()
    labels = [node.labels for node in allowed_robots(app, nodes)]
    return tuple(
        f"spec.overrides[{index}].nodeSelector: override {override.name} chooses none of the app's robots"
        for index, override in enumerate(app.spec.overrides)
        if not any(select_overrides((override,), own) for own in labels)
    )


def secret_notes(app: App, *, followed: bool) -> tuple[str, ...]:
    """Returns a sentence about Secrets whose changes restart nothing. followed: the namespace grants their versions."""
    if followed or app.spec.update.on_config_change != "Roll":
        return ()
    names = sorted(list_secrets(app, "$(ROBOTAPP_ROBOT)"))
    text = (
        f"a change of {'Secret' if len(names) == 1 else 'Secrets'} {shown(names, limit=3)} restarts nothing, because the operator may "
        f"not watch Secrets in namespace {app.namespace} (operator.watchSecretsIn of the chart)"
    )
    return (text,) if names else ()


def limit_note(pool: Pool) -> str:
    """That a pool's own limit of participants does nothing yet; "" for a pool that has the default."""
    notes = pool_notes(max_participants_per_host=pool.spec.max_participants_per_host)
    return "; ".join(f"DomainPool {pool.metadata.name}: {note.field} {note.message}" for note in notes)


def _placement_problems(app: App, nodes: Mapping[str, Node]) -> Iterator[Problem]:
    master = app.spec.placement.master_node
    if master and (
        master not in nodes or master in closed_nodes([node.metadata for node in nodes.values()], app.namespace)
    ):
        text = (
            f'there is no node "{master}" that admits namespace {app.namespace} (node annotation {Annotation.ALLOWED_NAMESPACES}); '
            "kubectl get nodes shows the names"
        )
        yield Problem(Reason.INVALID_SPEC, "spec.placement.masterNode", text, of_cluster=True)
    if app.spec.robots is None:
        return
    if not allowed_robots(app, nodes):
        text = (
            f"no robot that admits namespace {app.namespace} matches; {_robots_text(app, nodes)}: select one of them, or ask whoever "
            f"runs the robots to label a node {Label.ROBOT} or to add {app.namespace} to its annotation {Annotation.ALLOWED_NAMESPACES}"
        )
        yield Problem(Reason.NO_MATCHING_ROBOT, "spec.robots.nodeSelector", text, of_cluster=True)


def name_problems(app: App, robots: Iterable[str]) -> Mapping[str, str]:
    """Returns, by robot, why a name, key or label of the spec is none for it. Robots for which all of them are right are left out."""
    texts = [*list_helper_texts(app.written)]
    for component, at in _list_variants(app):
        texts += list_expanded_texts(component, at)
    texts = [text for text in texts if has_reference(text.text) and text.kind != "path"]
    names = sorted(filter(None, robots)) if texts else []
    decisive = {kind: decisive_robots(kind, names) for kind in {text.kind for text in texts}}
    problems: dict[str, str] = {}
    for text in texts:
        if any(expanded_problem(text, reference_values(robot, ordinal=0)) for robot in decisive[text.kind]):
            for robot in names:
                if robot not in problems and (wrong := expanded_problem(text, reference_values(robot, ordinal=0))):
                    problems[robot] = (
                        f"{text.path}: {text.text} is for robot {robot}: {wrong}; label the robot's node otherwise ({Label.ROBOT}), or "
                        "write another text"
                    )
    return problems


def decisive_robots(kind: str, robots: Sequence[str]) -> tuple[str, ...]:
    """Returns robots of which one spoils a text of this kind if any robot does: the first whose name alone is none, and the longest.

    A name that is one by itself makes no other text wrong than by its length. Thousands of texts for a thousand robots would
    otherwise hold the operator up for seconds whenever a node changes.
    """
    bare = ExpandedText("", kind, "$(ROBOTAPP_ROBOT)")
    first = next((robot for robot in robots if expanded_problem(bare, reference_values(robot))), None)
    return (*(() if first is None else (first,)), *((max(robots, key=len),) if robots else ()))


def _list_variants(app: App) -> Iterator[tuple[Component, str]]:
    """Yields each component as it is written, and what each override adds to one."""
    for index, component in enumerate(app.written.components):
        yield component, f"spec.components[{index}]"
    for index, override in enumerate(app.written.overrides):
        for position, part in enumerate(override.components):
            if part.env or part.parameters:
                only = Component(name=part.name, image="of-the-component")
                yield merge_component(only, part), f"spec.overrides[{index}].components[{position}]"


def _robots_text(app: App, nodes: Mapping[str, Node]) -> str:
    """Robots the app could name. Those that do not admit its namespace are other tenants' business: they read like none."""
    robots = sorted({robot_of(node) for node in open_robots(app, nodes)})
    if not robots:
        return f"no robot admits namespace {app.namespace}"
    return f"robots that admit namespace {app.namespace} are {shown(robots)}"
