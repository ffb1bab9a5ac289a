"""The facts of each instance, computed when something they depend on has changed, and otherwise remembered.

A change of one pod makes the facts of one instance stale. The others cost one comparison each.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from robotapp_api.values.placement.round_trips import UNREACHABLE_US
from robotapp_api.values.quantities.duration import parse_us
from robotapp_claims.rules.instances import Instance
from robotapp_client.api.times import Now, utc_now
from robotapp_operator.plan.diff.attempts import COMPLETION_TIME_FIELD, read_attempt
from robotapp_operator.plan.render.devices.ledger import list_handover_notes
from robotapp_operator.plan.render.instance_object import object_name
from robotapp_operator.plan.spec.config_content import list_config_maps, names_secrets
from robotapp_operator.plan.spec.desired import App, desired_of
from robotapp_operator.plan.spec.record import Record
from robotapp_operator.plan.spec.validate import notes_of, override_notes, secret_notes
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeKey, EdgeView, publish
from robotapp_operator.reconcile.reconcile_state import AppMemory, InstanceMemory, ReconcileState
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.facts.instance_facts import instance_facts, offline_s
from robotapp_operator.watch.lister import (
    app_of_instance,
    cached_domain,
    instance_status,
    instances_by_name,
    names_config,
    problems_now,
)


class Observer:
    """`clock` is monotonic, `now` the wall clock, by which the time of jobs runs. `on_change` is called with the app's uid and the name of an instance whose facts have changed."""

    def __init__(
        self,
        cache: Cache,
        memory: ReconcileState,
        *,
        clock: Callable[[], float],
        on_change: Callable[[str, str], None],
        now: Now = utc_now,
    ) -> None:
        self._cache = cache
        self._memory = memory
        self._clock = clock
        self._on_change = on_change
        self._now = now

    def app(self, record: Record, *, now: str) -> AppFacts | None:
        """Returns the facts of the app and all its instances; None when its spec cannot be parsed. `now`: RFC 3339, whole seconds."""
        facts = self.without_instances(record, now=now)
        if facts is None:
            return None
        instances = tuple(
            self.instance(facts.app, instance) for instance in instances_by_name(facts.app, self._cache).values()
        )
        return dataclasses.replace(facts, instances=instances)

    def without_instances(self, record: Record, *, now: str) -> AppFacts | None:
        """Returns the facts of the app alone; None when its spec cannot be parsed."""
        app = record.app
        if app is None:
            return None
        desired = desired_of(app, "")
        pool = self._cache.pools.get(app.pool) if app.ros_version == 2 else None
        limit = pool.spec.max_participants_per_host if pool else None
        secrets = app.namespace in self._cache.secret_versions
        return AppFacts(
            app=app,
            problems=problems_now(app, self._cache),
            notes=(
                *self._cache.answers.get(app, "notes", limit, lambda: notes_of(app, pool)),
                *self._cache.answers.get(
                    app, "overrides", self._cache.nodes.identity_version, lambda: override_notes(app, self._cache.nodes)
                ),
                *self._cache.answers.get(app, "secrets", secrets, lambda: secret_notes(app, followed=secrets)),
                *self._handover_notes(app),
            ),
            previous=record.status,
            now=now,
            rmw=desired.rmw,
            discovery=desired.discovery,
        )

    def _handover_notes(self, app: App) -> tuple[str, ...]:
        """Returns which devices no driver hands over, where one runs."""
        if not app.wants_devices:
            return ()
        version = (self._cache.allocations.version, self._cache.nodes.identity_version)

        def list_notes() -> tuple[str, ...]:
            drivers = self._cache.allocations.driver_nodes(self._cache.nodes)
            return list_handover_notes(app, instances_by_name(app, self._cache), drivers)

        notes: tuple[str, ...] = self._cache.answers.get(app, "handover", version, list_notes)
        return notes

    def instance(self, app: App, instance: Instance) -> InstanceFacts:
        """Returns the facts of one instance: those of the last call while nothing that they depend on has changed."""
        memory = self._memory.of(app.uid)
        instance_memory = memory.instance(instance.robot)
        stamp = self._stamp(app, instance, memory, instance_memory)
        now_s = self._clock()
        if (
            instance_memory.facts is not None
            and instance_memory.stamp == stamp
            and now_s < instance_memory.facts_until_s
        ):
            return instance_memory.facts
        before = instance_memory.facts
        facts = instance_facts(
            app,
            instance,
            self._cache,
            outcome=memory.outcomes.get(instance.robot),
            trouble=memory.troubles.get(instance.robot),
            held=memory.held.get(instance.robot, ()),
            barred=memory.barred.get(instance.robot, frozenset()),
            stays=instance_memory.stays,
            device_stays=instance_memory.device_stays,
            config_held=memory.config_held.get(instance.robot, ()),
            now_s=now_s,
            now=self._now(),
        )
        facts = self._publish(app, facts, instance_memory, now_s)
        lost = self._cache.nodes.lost(instance.node)
        if facts.grace and lost:
            instance_memory.facts_until_s = min(instance_memory.facts_until_s, offline_s(app, lost))
        if facts.changes_at is not None:
            change_s = now_s + (facts.changes_at - self._now()).total_seconds()
            instance_memory.facts_until_s = min(instance_memory.facts_until_s, change_s)
        if before == facts and before is not None:
            facts = before  # the same object, so that callers can compare by identity
        instance_memory.facts, instance_memory.stamp = (
            facts,
            self._stamp(app, instance, memory, instance_memory, facts=facts),
        )
        if before is not None and facts is not before:
            self._on_change(app.uid, instance.robot)
        return facts

    def _stamp(
        self,
        app: App,
        instance: Instance,
        memory: AppMemory,
        own: InstanceMemory,
        *,
        facts: InstanceFacts | None = None,
    ) -> tuple[object, ...]:
        """Equal stamps mean equal facts, apart from figures that may be published later."""
        facts = facts or own.facts
        views = [*facts.components, *(helper.view for helper in facts.helpers)] if facts else []
        nodes = {node for view in views for node in view.nodes}
        outcome = memory.outcomes.get(instance.robot)
        borrowed = app.spec.ros2 is not None and (app.share_with or app.spec.ros2.isolation == "Discovery")
        return (
            app.spec,
            instance,
            self._cache.version_of(app.uid, instance.robot),
            [self._cache.nodes.lost(node) for node in sorted({instance.node, *nodes})],
            outcome,
            memory.troubles.get(instance.robot),
            memory.held.get(instance.robot, ()),
            memory.barred.get(instance.robot, frozenset()),
            cached_domain(app, instance.robot, self._cache, outcome) if borrowed else None,
            memory.config_held.get(instance.robot, ()),
            self._config(app, instance),
            self._read_attempts(app, instance),
            (own.stays, own.device_stays),
            [self._cache.telemetry[node].status.devices for node in self._device_nodes(app, instance)],
            self._cache.allocations.version if app.wants_devices else None,
            self._cache.devices_version if facts and _looks_for_devices(app, facts) else None,
        )

    def _device_nodes(self, app: App, instance: Instance) -> list[str]:
        """Nodes that report about devices the instance holds."""
        held = self._cache.devices_held(app.uid, instance.robot) if app.wants_devices else ()
        return sorted({claim.spec.device.node for claim in held if claim.spec.device} & self._cache.telemetry.keys())

    def _read_attempts(self, app: App, instance: Instance) -> tuple[object, ...]:
        """Returns the part of the RobotAppInstance's status by which attempts are numbered."""
        status = instance_status(app, instance.robot, self._cache)
        return (read_attempt(status), COMPLETION_TIME_FIELD in status)

    def _config(self, app: App, instance: Instance) -> tuple[object, ...]:
        """The ConfigMaps and Secrets that the app names for the instance, as they are now."""
        if not names_config(app, self._cache):
            return ()
        app = app_of_instance(app, instance, self._cache)
        secrets = self._cache.secret_versions.get(app.namespace)
        return (
            *(self._cache.config_maps.get(name) for name in sorted(list_config_maps(app, instance.robot))),
            tuple(sorted(secrets.items())) if secrets and names_secrets(app) else secrets is None,
        )

    def _publish(self, app: App, found: InstanceFacts, own: InstanceMemory, now_s: float) -> InstanceFacts:
        if own.shown is None:
            own.shown = self._shown_before(app, found)
        for_s = app.budget_for_s
        own.measured = found.edges
        own.times.look(found.edges, now_s=now_s)
        published = publish(
            found.edges,
            own.shown,
            own.rest,
            now_s=now_s,
            lasts_from_s=lambda view: own.times.lasts_from_s(view, for_s=for_s),
        )
        own.shown = {edge.key: edge for edge in published.edges}
        own.facts_until_s = published.again_s
        return dataclasses.replace(found, edges=published.edges)

    def _shown_before(self, app: App, found: InstanceFacts) -> dict[EdgeKey, EdgeView]:
        """The figures in the stored object, so that a restart of the operator alone changes nothing."""
        name = f"{app.namespace}/{object_name(app.name, found.instance.robot)}"
        item = self._cache.instance_object_named.get(name)
        if item is None or item.spec.app_uid != app.uid:
            return {}
        edges = item.status.get("edges")
        stored = {_key(edge): edge for edge in (edges if isinstance(edges, list) else ()) if isinstance(edge, dict)}
        return {view.key: _as_stored(view, stored[view.key]) for view in found.edges if view.key in stored}


def _looks_for_devices(app: App, facts: InstanceFacts) -> bool:
    """Whether a change of any device may change its facts: it lacks one, or has a component that is not placed."""
    return facts.devices_held < facts.devices_wanted or (app.wants_devices and not facts.bound)


def _key(edge: Mapping[str, Any]) -> EdgeKey:
    return str(edge.get("kind")), str(edge.get("topic")), str(edge.get("from")), str(edge.get("to"))


def _as_stored(view: EdgeView, stored: Mapping[str, Any]) -> EdgeView:
    """The figures of a stored edge, with its verdict. A judged median is not stored, so today's takes its place."""
    try:
        p95_us: float | None = parse_us(stored["p95"]) if "p95" in stored else None
    except (TypeError, ValueError):
        p95_us = None
    measured = bool(stored.get("measured"))
    if measured and "p95" not in stored:
        p95_us = UNREACHABLE_US
    nodes = tuple(stored.get("nodes") or ())
    percentile = view.edge.latency.percentile if view.edge.latency else 95
    found = dataclasses.replace(
        view,
        nodes=view.nodes if nodes == tuple(node for node in view.nodes if node) else ("", ""),
        p95_us=p95_us,
        judged_us=p95_us if percentile == 95 else view.judged_us,
        measured=measured,
    )
    met, budget_us = stored.get("met"), view.budget_us
    if not isinstance(met, bool) or budget_us is None or found.met is met:
        return found
    # Today's median, or what is left of a rounded figure, would turn the verdict without the time that a turn must last.
    return dataclasses.replace(found, judged_us=budget_us if met else budget_us + 1)
