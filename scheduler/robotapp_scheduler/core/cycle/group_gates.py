"""PreEnqueue for pods of groups: enough of the group's pods must exist and, for a RobotApp, its spec must be readable and the
predecessor of a single-replica component gone. Pods with ROS fields wait while a kind that decides about them cannot be read.
"""

from collections.abc import Collection, Hashable
from typing import Any, Final

from robotapp_api.model.names import GROUP, Label, PodReason
from robotapp_api.values.placement.tiers import FAILOVER, ROBOT, on_disconnect
from robotapp_scheduler.core.api.core_v1 import Metadata
from robotapp_scheduler.core.api.pod_group import REPORT_AFTER_S
from robotapp_scheduler.core.api.robotics_v1alpha1 import Component
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import list_claim_keys, make_claim_key
from robotapp_scheduler.core.events.cluster_event import NODE, PLACED, Change, Event
from robotapp_scheduler.core.pods.pod_group_index import APIS, GroupRef, group_ref_of, in_group
from robotapp_scheduler.core.pods.pod_info import Member, PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import PreEnqueueStatus
from robotapp_scheduler.core.robotics.app_index import App, AppIndex, Replica, is_complete

GROUP_PLUGIN: Final = "RobotAppGroup"
KINDS_PLUGIN: Final = "RoboticsKinds"
KINDS_REPORT_AFTER_S: Final = 5.0
POD_GROUP_PLUGIN: Final = "PodGroup"
PREDECESSOR_PLUGIN: Final = "RobotAppPredecessor"
WHOLE_PLUGIN: Final = "PlacedWhole"
"""Stands beside the plugins that rejected a pod of a group: a change of the group's requirements may help, too."""
WHOLE_READS: Final = ("group",)
GROUP_EVENTS: Final = Change.APPS | Change.OWNERS | Change.POD_SEEN | PLACED
POD_GROUP_EVENTS: Final = Change.POD_GROUPS | Change.POD_SEEN | PLACED
PREDECESSOR_EVENTS: Final = GROUP_EVENTS | Change.TAINTS | Change.LABELS | NODE
"""Whether a node is lost, and whether it is a robot's, decides beside the pods."""
UNREACHABLE: Final = frozenset({"node.kubernetes.io/unreachable", "node.kubernetes.io/not-ready"})


def group_key(pod: PodInfo) -> Hashable | None:
    """Pods with equal keys are planned together: those of one app instance or PodGroup."""
    return (pod.member.app_uid, pod.member.instance) if pod.member is not None else pod.pod_group


def groups_of(seen: Event) -> tuple[str, ...]:
    """The groups an event concerns, by `PreEnqueueStatus.group`: pods, owners and claims have a RobotApp's uid as a label.

    A ResourceClaim is a group for the pods that it holds back.
    """
    found = seen.new if seen.new is not None else seen.old
    if found is None:
        return ()
    meta: Metadata = found.metadata
    if seen.resource == "resourceclaims":
        return (make_claim_key(meta.namespace, meta.name),)
    if seen.resource == "pods" and found.spec.resource_claims:
        return (*list_claim_keys(found), *_groups_of_object(seen.resource, found))
    return _groups_of_object(seen.resource, found)


def _groups_of_object(resource: str, found: Any) -> tuple[str, ...]:
    meta: Metadata = found.metadata
    if resource == "robotapps":
        return (meta.uid,)
    if resource == "podgroups":
        return tuple(GroupRef(api, meta.namespace, meta.name).key for api in APIS)
    if resource == "pods" and not in_group(found):
        return ()
    uid = (meta.labels or {}).get(Label.APP_UID)
    if uid:
        return (uid,)
    ref = group_ref_of(found) if resource == "pods" else None
    return (ref.key,) if ref is not None else ()


def groups_around(pod: PodInfo) -> tuple[str, ...]:
    """The group of one pod, by `PreEnqueueStatus.group`; empty for a pod without a group."""
    if pod.member is not None:
        return (pod.member.app_uid,)
    return (pod.pod_group.key,) if pod.pod_group is not None else ()


def changes_requirements(pod: PodInfo, seen: Event) -> bool:
    """Queueing hint of WHOLE_PLUGIN: True when the pod's own RobotApp or PodGroup changed its requirements."""
    same = seen.old is not None and seen.new is not None and seen.old.spec == seen.new.spec
    return not same and not set(groups_around(pod)).isdisjoint(groups_of(seen))


class GangGates:
    """PreEnqueue for pods of RobotApps and PodGroups. Other pods pass at once."""

    def __init__(self, cluster: Cache) -> None:
        self._cluster = cluster

    def __repr__(self) -> str:
        return f"GangGates({self._cluster.apps!r})"

    def gate(self, pod: PodInfo) -> PreEnqueueStatus | None:
        """Why the pod must wait before it may be tried, None when it may."""
        member = pod.member
        if self._cluster.unseen_kinds and (member is not None or pod.ros_request is not None):
            return _kinds_gate(self._cluster.unseen_kinds)
        if member is None:
            return self.pod_group_gate(pod)
        app = self._cluster.apps.app(member.app_uid)
        reason = self._unknown(pod, member, app)
        if reason is not None:
            return _group_gate(member, reason)
        if app is None or member.component not in app.components:
            return self._helper_gate(app, member)
        missing = self.missing(app, member.instance)
        if missing:
            return _group_gate(member, "waiting for pods of " + ", ".join(missing))
        return self._predecessor_gate(pod, member, app.components[member.component])

    def _helper_gate(self, app: App | None, member: Member) -> PreEnqueueStatus | None:
        """Returns why a discovery server, router or master waits: it goes near the components, so it starts with them.

        No pod waits for it, and where a component is placed it waits for none.
        """
        if app is None or any(
            replica.node for name in app.components for replica in self._cluster.apps.replicas(member, name)
        ):
            return None
        missing = self.missing(app, member.instance)
        return _group_gate(member, "waiting for pods of " + ", ".join(missing)) if missing else None

    def pod_group_gate(self, pod: PodInfo) -> PreEnqueueStatus | None:
        """Why a pod of a PodGroup must wait, None when it may be tried, or has no PodGroup."""
        ref = pod.pod_group
        if ref is None:
            return None
        known = self._cluster.pod_groups
        group = known.find(ref)
        if group is None:
            return _pod_group_gate(ref, f"waiting for PodGroup {ref.name} ({ref.api}) to be seen", REPORT_AFTER_S)
        spec = group.spec
        if spec.problem:
            return _pod_group_gate(ref, f"PodGroup {ref.name} cannot be planned: {spec.problem}", 0.0)
        needed, there = known.quorum(ref), known.ready(ref)
        if there >= needed:
            return None
        reason = f"waiting for pods of PodGroup {ref.name} ({there} of {needed})"
        return _pod_group_gate(ref, reason, spec.report_after_s)

    def missing(self, app: App, instance: str) -> list[str]:
        """Components of an instance that have fewer live pods than they should, as `driver (0 of 1)`."""
        found = []
        for name, component in app.components.items():
            live = sum(not _terminating(r) for r in self._cluster.apps.replicas(Member(app.uid, instance, name), name))
            if live < component.replicas and not is_complete(component, live):
                found.append(f"{name} ({live} of {component.replicas})")
        return found

    def predecessor(self, pod: PodInfo, member: Member, component: Component) -> Replica | None:
        """The other pod of this single-replica component that is on a node, None when there is none.

        A component that fails over does not wait for a pod on an unreachable node, unless that node is a robot's: its
        driver may still move the robot, so there a second pod starts beside it only where `Failover` is written.
        """
        if component.replicas != 1:
            return None
        for replica in self._cluster.apps.labelled(member):
            if not replica.node or replica.pod.metadata.uid == pod.uid:
                continue
            if fails_over(component) and self.lost(replica.node) and not self._may_drive(component, replica.node):
                continue
            return replica
        return None

    def _unknown(self, pod: PodInfo, member: Member, app: App | None) -> str | None:
        if app is None:
            return f"waiting for the RobotApp with uid {member.app_uid} to be seen"
        apps: AppIndex = self._cluster.apps
        if not apps.belongs(pod.pod, member.app_uid):
            return (
                "its owner chain (ReplicaSet and Deployment, or Job) does not lead to its RobotApp, or is not seen yet"
            )
        if app.problems:
            return "the RobotApp cannot be planned: " + "; ".join(app.problems)
        if not app.observed:
            generation = app.source.metadata.generation
            return f"waiting for the operator to act on generation {generation} of the RobotApp"
        return None

    def _predecessor_gate(self, pod: PodInfo, member: Member, component: Component) -> PreEnqueueStatus | None:
        before = self.predecessor(pod, member, component)
        if before is None:
            return None
        reason = f"waiting for its predecessor {before.pod.metadata.name} on {before.node} to end"
        if fails_over(component) and self.lost(before.node):
            reason += f": {_still_driving(before, gone=before.node not in self._cluster.nodes.row_of)}"
        return PreEnqueueStatus(
            plugin=PREDECESSOR_PLUGIN,
            reason=reason,
            events=PREDECESSOR_EVENTS,
            group="" if fails_over(component) else member.app_uid,
            code=str(PodReason.WAITING_FOR_PREDECESSOR),
        )

    def lost(self, node: str) -> bool:
        """Is the node gone or out of reach? The taint that evicts stays for seconds after a node is back, with pods that came since."""
        row = self._cluster.nodes.row_of.get(node)
        if row is None:
            return True
        taints = self._cluster.nodes.taints
        return any(
            taint.key in UNREACHABLE and taint.effect == "NoSchedule" for taint in taints.values[taints.column[row]]
        )

    def _may_drive(self, component: Component, node: str) -> bool:
        """Whether a pod of this component on a lost node may still move a robot, and the spec does not allow a second one.

        Whether a node that is gone was a robot's is unknown: then it counts as one if the component may run on robots.
        """
        if component.on_disconnect == FAILOVER:
            return False
        on_robot = self._cluster.nodes.on_robot(node)
        return on_robot if on_robot is not None else not component.runs_on or ROBOT in component.runs_on


def fails_over(component: Component) -> bool:
    """onDisconnect: Failover, which is also the default where the component may run elsewhere than on its robot."""
    return on_disconnect(component.runs_on, component.on_disconnect) == FAILOVER


def _still_driving(before: Replica, *, gone: bool) -> str:
    """Why the pod waits for a predecessor on a lost node, and what the user can do."""
    where = "its node is gone and may be" if gone else "its node cannot be reached and is"
    return (
        f"{where} a robot's computer, where the pod may still drive; if it surely stopped, delete pod "
        f"{before.pod.metadata.name} with --force; to start a second one without waiting, write onDisconnect: Failover"
    )


def _terminating(replica: Replica) -> bool:
    return replica.pod.metadata.deletion_timestamp is not None


def _kinds_gate(kinds: Collection[str]) -> PreEnqueueStatus:
    names = ", ".join(f"{kind}.{GROUP}" for kind in kinds)
    return PreEnqueueStatus(
        plugin=KINDS_PLUGIN,
        reason=f"waiting for {names}: the CRD is not installed, or the scheduler may not list it (its log has the answer)",
        events=Change.APPS,
        code=str(PodReason.WAITING_FOR_KINDS),
        report_after_s=KINDS_REPORT_AFTER_S,
    )


def _group_gate(member: Member, reason: str) -> PreEnqueueStatus:
    return PreEnqueueStatus(
        plugin=GROUP_PLUGIN,
        reason=reason,
        events=GROUP_EVENTS,
        group=member.app_uid,
        code=str(PodReason.WAITING_FOR_GROUP),
    )


def _pod_group_gate(ref: GroupRef, reason: str, report_after_s: float) -> PreEnqueueStatus:
    return PreEnqueueStatus(
        plugin=POD_GROUP_PLUGIN,
        reason=reason,
        events=POD_GROUP_EVENTS,
        group=ref.key,
        code=str(PodReason.WAITING_FOR_GROUP),
        whole_group=True,
        report_after_s=report_after_s,
    )
