"""PodGroups and their pods, for the core and as objects of an API server."""

from collections.abc import Iterable
from typing import Any

import msgspec
from tests.support.scheduling import Json, make_pod

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.pod_group import GivenPodGroup
from robotapp_scheduler.core.cycle.group_gates import groups_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.pods.pod_group_index import COSCHEDULING, POD_GROUP_LABEL
from robotapp_scheduler.core.queue.queued_pod_info import Rejection


def pod_group(name: str = "team", *, min_member: Any = 3, **spec: Any) -> GivenPodGroup:
    """A PodGroup of scheduling.x-k8s.io."""
    raw = {"metadata": {"name": name, "namespace": "default"}, "spec": {"minMember": min_member, **spec}}
    return msgspec.convert(raw, GivenPodGroup)


def workload_group(name: str = "team", *, policy: Json, **fields: Any) -> GivenPodGroup:
    """A PodGroup of scheduling.k8s.io/v1beta1."""
    spec = {"schedulingPolicy": policy, **fields.pop("spec", {})}
    return msgspec.convert({"metadata": {"name": name, "namespace": "default"}, "spec": spec, **fields}, GivenPodGroup)


def team_pod(name: str, *, group: str = "team", labels: dict[str, str] | None = None, **fields: Any) -> Pod:
    """A pod that names its group by label."""
    return make_pod(name, labels={POD_GROUP_LABEL: group, **(labels or {})}, **fields)


def workload_pod(name: str, *, group: str = "team", **fields: Any) -> Pod:
    """A pod that names its group in spec.schedulingGroup."""
    return make_pod(name, schedulingGroup={"podGroupName": group}, **fields)


def tell(core: SchedulerCore, event: Event) -> None:
    """What the shell does with a change."""
    if event.change:
        core.queue.move(event, groups=groups_of(event))


def announce(core: SchedulerCore, group: GivenPodGroup, api: str = COSCHEDULING) -> None:
    """The watch shows a PodGroup."""
    change = core.cluster.pod_groups.apply(group, api)
    tell(core, Event("podgroups", change, None, group))


def arrive(core: SchedulerCore, *pods: Pod) -> None:
    """The watch shows new pods of ours."""
    for pod in pods:
        change = core.cluster.apply_pod(pod)
        if not pod.spec.node_name:
            core.queue.add(pod)
        tell(core, Event("pods", change, None, pod))


def depart(core: SchedulerCore, *pods: Pod) -> None:
    """Pods are gone."""
    for pod in pods:
        core.queue.delete(pod.metadata.uid)
        tell(core, Event("pods", core.cluster.remove_pod(pod), pod, None))


def run(core: SchedulerCore, *, lose: Iterable[str] = ()) -> dict[str, str]:
    """Pop and schedule until nothing is left; answers node by pod name. Binds of `lose` fail: they are put back."""
    placed: dict[str, str] = {}
    while batch := core.queue.pop():
        for decision in core.schedule(batch):
            assert decision.queued is not None
            if decision.node is None:
                core.queue.requeue(decision.queued, Rejection(plugins=decision.rejected_by))
            elif decision.pod.name in lose:
                core.cluster.forget(decision.pod.uid)
                core.queue.requeue(decision.queued, Rejection(plugins=frozenset({"never"})))
            else:
                core.queue.done(decision.pod.uid)
                placed[decision.pod.name] = decision.node
    return placed


def confirm(core: SchedulerCore, pods: Iterable[Pod]) -> None:
    """The watch shows assumed pods on their nodes."""
    for pod in pods:
        record = core.cluster.placed.get(pod.metadata.uid)
        if record is not None and record.assumed:
            bound = msgspec.structs.replace(pod, spec=msgspec.structs.replace(pod.spec, node_name=record.node))
            tell(core, Event("pods", core.cluster.apply_pod(bound), pod, bound))
