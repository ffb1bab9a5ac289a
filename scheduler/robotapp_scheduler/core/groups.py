"""When may the pods of a RobotApp instance be tried: all there, the app understood, the predecessor gone."""

from collections.abc import Hashable
from typing import Final

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.apps import App, AppIndex, Replica
from robotapp_scheduler.core.changes import PLACED, Change
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.pods import Member, PodInfo
from robotapp_scheduler.core.queued import Gate
from robotapp_scheduler.core.robotics import Component

GROUP_PLUGIN: Final = "RobotAppGroup"
PREDECESSOR_PLUGIN: Final = "RobotAppPredecessor"
REPORT_AFTER_S: Final = 30.0
"""A group that is incomplete for longer is named in the app's and the pods' conditions."""
GROUP_EVENTS: Final = Change.APPS | Change.OWNERS | Change.POD_SEEN | PLACED
UNREACHABLE: Final = frozenset({"node.kubernetes.io/unreachable", "node.kubernetes.io/not-ready"})


def group_key(pod: PodInfo) -> Hashable | None:
    """Pods with equal keys are planned together: those of one app instance."""
    return (pod.member.app_uid, pod.member.instance) if pod.member is not None else None


class Groups:
    """PreEnqueue for pods of RobotApps. Other pods pass at once."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster

    def __repr__(self) -> str:
        return f"Groups({self._cluster.apps!r})"

    def gate(self, pod: PodInfo) -> Gate | None:
        """Why the pod must wait before it may be tried, None when it may."""
        member = pod.member
        if member is None:
            return None
        app = self._cluster.apps.app(member.app_uid)
        reason = self._unknown(pod, member, app)
        if reason is not None:
            return _group_gate(member, reason)
        if app is None or member.component not in app.components:
            return None  # roscore, discovery servers: parts the operator adds, nobody waits for them
        missing = self.missing(app, member.instance)
        if missing:
            return _group_gate(member, "waiting for pods of " + ", ".join(missing))
        return self._predecessor_gate(pod, member, app.components[member.component])

    def missing(self, app: App, instance: str) -> list[str]:
        """Components of an instance that have fewer live pods than they should, as `driver (0 of 1)`."""
        found = []
        for name, component in app.components.items():
            live = sum(not _terminating(r) for r in self._cluster.apps.replicas(Member(app.uid, instance, name), name))
            if live < component.replicas:
                found.append(f"{name} ({live} of {component.replicas})")
        return found

    def predecessor(self, pod: PodInfo, member: Member, component: Component) -> Replica | None:
        """The pod that still does this single-replica component's work, None when there is none.

        A component that fails over does not wait for a pod on a node nobody can reach.
        """
        if component.replicas != 1:
            return None
        for replica in self._cluster.apps.labelled(member):
            if not replica.node or replica.pod.metadata.uid == pod.uid:
                continue
            if fails_over(component) and self._lost(replica.node):
                continue
            return replica
        return None

    def _unknown(self, pod: PodInfo, member: Member, app: App | None) -> str | None:
        if app is None:
            return f"waiting for the RobotApp with uid {member.app_uid} to be seen"
        apps: AppIndex = self._cluster.apps
        if not apps.belongs(pod.pod, member.app_uid):
            return "its owner chain (ReplicaSet, Deployment) does not lead to its RobotApp, or is not seen yet"
        if app.problems:
            return "the RobotApp cannot be planned: " + "; ".join(app.problems)
        if not app.observed:
            generation = app.source.metadata.generation
            return f"waiting for the operator to act on generation {generation} of the RobotApp"
        return None

    def _predecessor_gate(self, pod: PodInfo, member: Member, component: Component) -> Gate | None:
        before = self.predecessor(pod, member, component)
        if before is None:
            return None
        return Gate(
            plugin=PREDECESSOR_PLUGIN,
            reason=f"waiting for its predecessor {before.pod.metadata.name} on {before.node} to end",
            events=GROUP_EVENTS | Change.TAINTS | Change.NODE_REMOVED,
            app_uid="" if fails_over(component) else member.app_uid,
            code=str(PodReason.WAITING_FOR_PREDECESSOR),
        )

    def _lost(self, node: str) -> bool:
        row = self._cluster.nodes.row_of.get(node)
        if row is None:
            return True
        taints = self._cluster.nodes.taints
        return any(taint.key in UNREACHABLE for taint in taints.values[taints.column[row]])


def fails_over(component: Component) -> bool:
    """onDisconnect: Failover, which is also the default where the component is not tied to its robot."""
    return (component.on_disconnect or ("Keep" if component.runs_on == "Robot" else "Failover")) == "Failover"


def _terminating(replica: Replica) -> bool:
    return replica.pod.metadata.deletion_timestamp is not None


def _group_gate(member: Member, reason: str) -> Gate:
    return Gate(
        plugin=GROUP_PLUGIN,
        reason=reason,
        events=GROUP_EVENTS,
        app_uid=member.app_uid,
        code=str(PodReason.WAITING_FOR_GROUP),
    )
