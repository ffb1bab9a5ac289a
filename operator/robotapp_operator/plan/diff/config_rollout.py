"""Rollout of configuration: what each component is rendered with, by the contents of its ConfigMaps and Secrets."""

import dataclasses
from collections.abc import Mapping
from datetime import datetime

from robotapp_api.model.names import Annotation
from robotapp_operator.plan.diff.diff import Observed
from robotapp_operator.plan.render.child import DEPLOYMENT
from robotapp_operator.plan.render.parameters import NONE, ParameterState, parameter_states
from robotapp_operator.plan.spec.config_content import ClusterConfig, ConfigContent, config_content
from robotapp_operator.plan.spec.config_record import (
    ConfigDecision,
    ConfigRecord,
    decide_config,
    parse_record,
    record_content,
)
from robotapp_operator.plan.spec.desired import App, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, pod_annotations
from robotapp_operator.plan.spec.text import shown


@dataclasses.dataclass(frozen=True, slots=True)
class ConfigRollout:
    """The states to render components with. held: sentences about restarts that wait. due: when the first of them may be."""

    states: Mapping[str, ParameterState]
    held: tuple[str, ...] = ()
    due: datetime | None = None


def plan_config(
    app: App, robot: str, cluster_config: ClusterConfig, observed: Mapping[ChildRef, Observed], *, now: datetime
) -> ConfigRollout:
    """Decides for each component of an instance what its pods run with. observed: the instance's children."""
    desired = desired_of(app, robot)
    files = parameter_states(app, robot, cluster_config.config_maps)
    states: dict[str, ParameterState] = {}
    sentences: list[str] = []
    moments: list[datetime] = []
    for component in app.spec.components:
        item = observed.get(ChildRef(DEPLOYMENT, desired.name_of(component.name)))
        over = item if isinstance(item, Deployment) and item.metadata.controller_uid == app.uid else None
        state = files.get(component.name, NONE)
        content = config_content(component, app, robot, cluster_config)
        decision = _decide(app, content, over, state, now=now)
        if decision is None:
            states[component.name] = state
            continue
        states[component.name] = _effective(state, decision)
        if decision.held_text and decision.due:
            sentences.append(f"{component.name}: {decision.held_text}")
            moments.append(decision.due)
    return ConfigRollout(states, tuple(sentences), min(moments, default=None))


def _decide(
    app: App, content: ConfigContent, over: Deployment | None, state: ParameterState, *, now: datetime
) -> ConfigDecision | None:
    """Returns None for a component that reads no ConfigMap, and no Secret whose version is or was known."""
    record = parse_record(over.metadata.annotations.get(Annotation.CONFIG, "")) if over else None
    if record is not None and record.references == content.references:
        content = content.with_unfollowed(record.mounted, record.files)
    if not content:
        return None
    absent = sorted(state.absent)
    # Pods that are yet to come start with what there is then.
    if over is None or record is None or app.spec.suspend or over.replicas == 0:
        before = record or ConfigRecord(config_hash=_annotated(over))
        return ConfigDecision(record=record_content(content, file_hash=state.hash, absent=absent, before=before))
    return decide_config(
        record,
        content,
        file_hash=state.hash,
        absent=absent,
        rolls_out=app.spec.update.on_config_change == "Roll",
        startable=not content.missing,
        now=now,
    )


def _annotated(over: Deployment | None) -> str:
    """Returns the hash that a template without a record carries, as after somebody removed the record."""
    return pod_annotations(over.spec).get(Annotation.CONFIG_HASH, "") if over else ""


def _effective(state: ParameterState, decision: ConfigDecision) -> ParameterState:
    record = decision.record
    return dataclasses.replace(
        state,
        absent=frozenset(record.absent),
        hash=record.file_hash,
        config_hash=record.config_hash,
        record=record.text(),
        change=shown(decision.changed, limit=3) if decision.changed else "",
    )
