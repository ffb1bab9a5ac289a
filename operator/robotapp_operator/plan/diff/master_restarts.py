"""Restarts of ROS 1 nodes whose master was started anew: a new master has no names and topics, and a node registers only once.

The starts of masters for which a component was restarted stand in an annotation of its pod template, so writing one rolls the
pods and is remembered in the same write. What to write follows from what is observed: a repeated decision writes nothing.
"""

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_operator.plan.diff.diff import Change
from robotapp_operator.plan.render.infrastructure import MASTER_ROLE
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import ContainerStatus, Deployment, Pod, pod_annotations
from robotapp_operator.plan.spec.text import shown

START_LEAD: Final = timedelta(seconds=5)
"""Pods of one start are made together, in any order. A node that waited longer for its first master loses nothing by a restart."""
MOST_RESTARTS: Final = 5
"""Restarts of a component within `WINDOW`: a master that crashes for ever must not restart the nodes for ever."""
WINDOW: Final = timedelta(hours=24)
_SEPARATOR: Final = ","


class MasterStart(NamedTuple):
    """A start of a master that is ready. Nodes that have run since before `limit` cannot have registered with it."""

    moment: datetime
    limit: datetime


class NodeRestart(NamedTuple):
    """Restarts of one component: the annotation to render ("" for none), which has one start more if a restart is due."""

    record: str
    refused: tuple[str, ...] = ()
    """Pods that the master does not have and that are not restarted, because they were restarted too often."""


def plan_restarts(deployments: Iterable[Deployment], pods: Mapping[str, Sequence[Pod]]) -> dict[str, NodeRestart]:
    """Returns what to do by component. pods: by the uid of their Deployment. Nothing is restarted before the master is ready."""
    masters: list[Pod] = []
    components: dict[str, Deployment] = {}
    for item in deployments:
        if item.metadata.labels.get(Label.ROLE) == MASTER_ROLE:
            masters += pods.get(item.metadata.uid, ())
        elif name := item.metadata.labels.get(Label.COMPONENT, ""):
            components[name] = item
    start = find_start(masters)
    return {name: _plan_restart(item, pods.get(item.metadata.uid, ()), start) for name, item in components.items()}


def ros_deployments(app: App, deployments: Iterable[Deployment]) -> list[Deployment]:
    """Returns the Deployments of the master and of the components that register with it: those that use ROS."""
    names = {component.name for component in app.ros_components}
    return [
        item
        for item in deployments
        if item.metadata.labels.get(Label.ROLE) or item.metadata.labels.get(Label.COMPONENT) in names
    ]


def find_start(masters: Sequence[Pod]) -> MasterStart | None:
    """Returns the start of the present master, None while none is ready.

    Between the end of a master and the start of the next one a node waits, and registers with the next.
    """
    ready = [pod for pod in masters if pod.is_ready]
    if not ready:
        return None
    master = max(ready, key=lambda pod: pod.metadata.creation_timestamp or "")
    container = _find_container(master, MASTER_ROLE)
    running = container.state.running if container is not None else None
    began = _moment(running.started_at if running else None)
    if container is not None and container.restart_count and began:
        last = container.last_state.terminated
        return MasterStart(began, _moment(last.finished_at if last else None) or began - START_LEAD)
    created = _moment(master.metadata.creation_timestamp)
    return MasterStart(created, created - START_LEAD) if created else None


def is_restart(change: Change) -> bool:
    """Returns whether the write restarts a component because its master was started anew."""
    starts = read_master_starts(change.child.spec)
    return change.over is not None and starts not in ("", read_master_starts(change.over.spec))


def describe_restart(components: Sequence[str], record: str) -> str:
    """Returns the text of the event. record: the annotation that was written, which ends with the master's start."""
    start = record.rpartition(_SEPARATOR)[2]
    return f"the ROS master was started anew at {start} without the names and topics of its nodes: {shown(components)} restarted"


def read_master_starts(spec: Mapping[str, object]) -> str:
    """Returns the annotation of a Deployment's pod template, "" for none."""
    text = pod_annotations(spec).get(Annotation.MASTER_STARTS, "")
    return text if isinstance(text, str) else ""


def _plan_restart(deployment: Deployment, pods: Sequence[Pod], start: MasterStart | None) -> NodeRestart:
    record = read_master_starts(deployment.spec)
    node = deployment.metadata.labels.get(Label.COMPONENT, "")
    strangers = [pod.metadata.name for pod in pods if start is not None and _has_run_since(pod, node, start.limit)]
    if start is None or not strangers:
        return NodeRestart(record)
    earlier = _parse(record)
    if start.moment in earlier:
        return NodeRestart(record)  # these pods are about to be replaced
    if len([moment for moment in earlier if start.moment - moment < WINDOW]) >= MOST_RESTARTS:
        return NodeRestart(record, refused=tuple(sorted(strangers)))
    newest = [*earlier, start.moment][-MOST_RESTARTS:]
    return NodeRestart(_SEPARATOR.join(whole_seconds(moment) for moment in newest))


def _has_run_since(pod: Pod, node: str, limit: datetime) -> bool:
    """Returns whether the node has run without a pause since before `limit`. One that has not started yet will register by itself.

    node: the name of its container. Other containers of the pod may have started at other times.
    """
    container = _find_container(pod, node)
    running = container.state.running if container is not None else None
    began = _moment(running.started_at if running else None)
    return _is_here(pod) and began is not None and began < limit


def _is_here(pod: Pod) -> bool:
    return not pod.terminal and pod.metadata.deletion_timestamp is None


def _find_container(pod: Pod, name: str) -> ContainerStatus | None:
    return next((status for status in pod.status.container_statuses if status.name == name), None)


def _moment(text: str | None) -> datetime | None:
    """Returns the time in UTC, None also for one before the epoch: a runtime that has lost a container reports the year 1."""
    try:
        moment = datetime.fromisoformat(text) if text else None
        if moment is None or moment.tzinfo is None or moment.year < 1970:
            return None
        return moment.astimezone(UTC)
    except (ValueError, OverflowError):  # the last hours of the year 9999 in the west
        return None


def _parse(record: str) -> list[datetime]:
    """Returns the times in it. What is none was not written by us and does not count."""
    return [moment for text in record.split(_SEPARATOR) if (moment := _moment(text))]
