"""PodGroups: which pods must be placed together, how many at least, and how many of them there are.

Two APIs define it: `scheduling.x-k8s.io/v1alpha1` (the label `scheduling.x-k8s.io/pod-group`) and `scheduling.k8s.io/v1beta1`
(`spec.schedulingGroup`), where the API server serves it. A pod of a RobotApp goes by its app alone.
"""

from typing import Final, NamedTuple

from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.pod_group import GivenPodGroup, PodGroup, understood
from robotapp_scheduler.core.events.cluster_event import Change

COSCHEDULING: Final = "scheduling.x-k8s.io"
WORKLOADS: Final = "scheduling.k8s.io"
APIS: Final = (COSCHEDULING, WORKLOADS)
POD_GROUP_LABEL: Final = "scheduling.x-k8s.io/pod-group"
_APP_UID: Final = Label.APP_UID.value


class GroupRef(NamedTuple):
    """The group that a pod names."""

    api: str
    namespace: str
    name: str

    @property
    def key(self) -> str:
        """One text for all of it, unlike any RobotApp's uid."""
        return f"{self.api}/{self.namespace}/{self.name}"


def in_group(pod: Pod) -> bool:
    """May it belong to a RobotApp or a PodGroup? A cheap test before `group_ref_of`."""
    labels = pod.metadata.labels
    if labels and (_APP_UID in labels or POD_GROUP_LABEL in labels):
        return True
    return pod.spec.scheduling_group is not None


def group_ref_of(pod: Pod) -> GroupRef | None:
    """The PodGroup of a pod, None for pods without one and for those of a RobotApp."""
    labels = pod.metadata.labels or {}
    if labels.get(Label.APP_UID):
        return None
    group = pod.spec.scheduling_group
    if group is not None and group.pod_group_name:
        return GroupRef(WORKLOADS, pod.metadata.namespace, group.pod_group_name)
    name = labels.get(POD_GROUP_LABEL)
    return GroupRef(COSCHEDULING, pod.metadata.namespace, name) if name else None


class _Place(NamedTuple):
    """What one live pod counts as: on a node, confirmed there, placed or free to be tried."""

    placed: bool
    bound: bool
    ready: bool


NOWHERE: Final = _Place(placed=False, bound=False, ready=False)


class _Standing:
    """One group's object, if seen, and counts of its live pods (none that terminate)."""

    __slots__ = ("bound", "done", "group", "placed", "pods", "ready")

    def __init__(self) -> None:
        self.group: PodGroup | None = None
        self.pods: dict[str, _Place] = {}
        self.placed = self.bound = self.ready = 0
        self.done = False
        """Enough of them were seen on nodes: a pod that comes later is a late member."""

    def count(self, place: _Place, sign: int) -> None:
        self.placed += sign * place.placed
        self.bound += sign * place.bound
        self.ready += sign * place.ready


class PodGroups:
    """PodGroups by reference, and the live pods that name them, of any scheduler."""

    def __init__(self) -> None:
        self._standing: dict[GroupRef, _Standing] = {}
        self._completed: dict[GroupRef, str] = {}
        """The uid of each group that became whole: its name may soon be another's."""

    def __repr__(self) -> str:
        return f"PodGroups({len(self._standing)})"

    def apply(self, given: GivenPodGroup, api: str) -> Change:
        """A PodGroup of this API appeared or changed. One with the apiVersion of another API is left alone."""
        if given.api_version and not given.api_version.startswith(f"{api}/"):
            return Change.NONE
        group = understood(given)
        ref = GroupRef(api, group.metadata.namespace, group.metadata.name)
        standing = self._at(ref)
        old, standing.group = standing.group, group
        self._judge(ref, standing)
        return Change.NONE if old is not None and old.spec == group.spec else Change.POD_GROUPS

    def remove(self, group: GivenPodGroup, api: str) -> Change:
        """A PodGroup is gone."""
        ref = GroupRef(api, group.metadata.namespace, group.metadata.name)
        standing = self._standing.get(ref)
        if standing is None or standing.group is None:
            return Change.NONE
        standing.group = None
        self._completed.pop(ref, None)
        self._tidy(ref, standing)
        return Change.POD_GROUPS

    def place(self, pod: Pod, node: str) -> None:
        """Count a live pod of a group where it is (node "" = still waiting); others are not counted."""
        ref = group_ref_of(pod)
        if ref is None:
            return
        stays = pod.metadata.deletion_timestamp is None
        placed = stays and bool(node)
        ready = placed or (stays and not pod.spec.scheduling_gates)
        place = _Place(placed=placed, bound=placed and bool(pod.spec.node_name), ready=ready)
        standing = self._at(ref)
        standing.count(standing.pods.get(pod.metadata.uid, NOWHERE), -1)
        standing.count(place, +1)
        standing.pods[pod.metadata.uid] = place
        self._judge(ref, standing)

    def drop(self, pod: Pod) -> None:
        """Stop counting a pod that is gone or terminal."""
        ref = group_ref_of(pod)
        if ref is None:
            return
        standing = self._standing.get(ref)
        if standing is not None:
            standing.count(standing.pods.pop(pod.metadata.uid, NOWHERE), -1)
            if not standing.pods:
                standing.done = False  # the next ones are a new generation
                self._completed.pop(ref, None)
            self._tidy(ref, standing)

    def find(self, ref: GroupRef) -> PodGroup | None:
        """The group's object, None when it is not in the cache."""
        standing = self._standing.get(ref)
        return standing.group if standing is not None else None

    def ready(self, ref: GroupRef) -> int:
        """Live pods of the group that are on a node or may be tried."""
        standing = self._standing.get(ref)
        return standing.ready if standing is not None else 0

    def placed(self, ref: GroupRef) -> int:
        """Live pods of the group on nodes, assumed ones included."""
        standing = self._standing.get(ref)
        return standing.placed if standing is not None else 0

    def quorum(self, ref: GroupRef) -> int:
        """How many must be on nodes together; 0 once they were: late members are placed one by one."""
        standing = self._standing.get(ref)
        if standing is None or standing.group is None or standing.done:
            return 0
        return 0 if standing.placed and standing.group.was_placed else standing.group.spec.needed

    def take_completed(self) -> list[tuple[GroupRef, str]]:
        """Groups, each with its uid, of which since the last call as many pods as they require were seen bound."""
        found = list(self._completed.items())
        self._completed.clear()
        return found

    def missed(self, api: str) -> bool:
        """Whether a live pod names a group of this API that is not in the cache."""
        return any(ref.api == api and found.group is None and found.pods for ref, found in self._standing.items())

    def _at(self, ref: GroupRef) -> _Standing:
        return self._standing.setdefault(ref, _Standing())

    def _tidy(self, ref: GroupRef, standing: _Standing) -> None:
        if standing.group is None and not standing.pods:
            del self._standing[ref]

    def _judge(self, ref: GroupRef, standing: _Standing) -> None:
        if standing.done or standing.group is None:
            return
        spec = standing.group.spec
        if spec.problem or standing.bound < max(spec.needed, 1):
            return
        standing.done = True
        self._completed[ref] = standing.group.metadata.uid
