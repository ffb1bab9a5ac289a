"""What the watch showed about pods and nodes, judged at every event: the rules that no fault may break. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Room:
    """What one node can take."""

    pods: int
    cpu_milli: int


@dataclass(slots=True)
class Known:
    """A live pod as last seen."""

    name: str
    cpu_milli: int
    node: str = ""
    reported: str = ""
    """Reason of PodScheduled=False, empty while there is none."""


@dataclass(slots=True)
class History:
    """Fed with every event of the pod watch in its order. `problems` lists each broken rule once.

    While the watch was away deletions and binds come in no order: `settle` judges the nodes after such a list.
    """

    rooms: Mapping[str, Room]
    problems: list[str] = field(default_factory=list)
    binds: int = 0
    live: dict[str, Known] = field(default_factory=dict)
    _pods: dict[str, int] = field(default_factory=dict)
    _cpu: dict[str, int] = field(default_factory=dict)
    _unbound: set[str] = field(default_factory=set)
    _full: set[str] = field(default_factory=set)

    def seen(self, uid: str, pod: Known, *, ordered: bool = True) -> None:
        """A pod appeared or changed."""
        old = self.live.get(uid)
        before = old.node if old is not None else ""
        self.live[uid] = pod
        if not pod.node:
            self._unbound.add(uid)
        if before == pod.node:
            return
        if before:
            self.problems.append(f"{pod.name} moved from {before} to {pod.node or 'nowhere'}")
            self._count(before, pod, -1)
        if pod.node:
            self.binds += 1
            self._unbound.discard(uid)
            self._count(pod.node, pod, +1)
            if ordered:
                self._judge(pod.node)

    def gone(self, uid: str) -> None:
        """A pod was deleted."""
        pod = self.live.pop(uid, None)
        self._unbound.discard(uid)
        if pod is not None and pod.node:
            self._count(pod.node, pod, -1)
            self._full.discard(pod.node)

    def settle(self) -> None:
        """Judge every node now."""
        for node in self._pods:
            self._judge(node)

    @property
    def bound(self) -> int:
        return len(self.live) - len(self._unbound)

    @property
    def unbound(self) -> list[Known]:
        return [self.live[uid] for uid in self._unbound]

    def bound_uids(self) -> list[str]:
        return [uid for uid in self.live if uid not in self._unbound]

    def unsettled(self) -> list[str]:
        """Pods that should not be as they are once everything has come to rest: not bound although a node has room for
        them, or neither bound nor told why. Empty = at rest."""
        free = [
            (room.cpu_milli - self._cpu.get(name, 0))
            for name, room in self.rooms.items()
            if self._pods.get(name, 0) < room.pods
        ]
        most = max(free, default=-1)
        found = []
        for pod in self.unbound:
            if pod.cpu_milli <= most:
                found.append(f"{pod.name} would fit and is not bound ({pod.reported or 'nothing reported'})")
            elif pod.reported != "Unschedulable":
                found.append(f"{pod.name} is neither bound nor reported ({pod.reported or 'nothing'})")
        return found

    def _count(self, node: str, pod: Known, sign: int) -> None:
        self._pods[node] = self._pods.get(node, 0) + sign
        self._cpu[node] = self._cpu.get(node, 0) + sign * pod.cpu_milli

    def _judge(self, node: str) -> None:
        room = self.rooms.get(node)
        if room is None:
            self.problems.append(f"a pod was bound to {node}, which is no node of ours")
            return
        if node in self._full or (self._pods[node] <= room.pods and self._cpu[node] <= room.cpu_milli):
            return
        self._full.add(node)
        self.problems.append(
            f"{node} holds {self._pods[node]} pods of {room.pods} and {self._cpu[node]}m of {room.cpu_milli}m CPU"
        )
