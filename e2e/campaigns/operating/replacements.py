"""Is there ever a second publisher? Pods of single-replica components are replaced by force, and a watch of its own counts pods.

Pods are deleted, evicted, drained and edited, and nodes fall silent or are deleted and come back, under components with each
`onDisconnect`. Nodes and kubelets are simulated; control plane, operator and scheduler are real. A pod may run from its binding
until its object is gone or its containers have ended. While the node of a component that fails over is lost, two may run: such
overlaps are promised, and counted apart.
"""

import argparse
import random
import statistics
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from campaigns.common import options
from campaigns.common.output import save
from campaigns.operating.out_of_sight import Fleet
from campaigns.rigs.live import Tenant, eventually, part
from campaigns.storm.history import Event
from campaigns.storm.recorder import Recorder
from robotapp_api.model.names import Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines import topology

STRATEGIC: Final = "application/strategic-merge-patch+json"
COMPONENT: Final = "driver"
LANE: Final = "test.example/lane"
SLOW: Final = "test.example/slow"
"""Finalizer on a pod: its containers take a while to end. kwok alone ends them at once."""
MOST_SLOW_S: Final = 1.0
GRACE_S: Final = 2
AWAY_S: Final = 3.0
"""A node is away for this long before anybody looks whether a successor started too early."""
ENDED: Final = frozenset({"Succeeded", "Failed"})
PATIENCE_S: Final = 120.0
"""Taints that evict are put on one node of a zone in ten seconds."""


@dataclass(frozen=True, slots=True)
class Kind:
    """`runs_on` and `on_disconnect` of a lane's component."""

    runs_on: tuple[str, ...]
    on_disconnect: str = ""

    def fails_over(self, node: str, force: str) -> bool:
        """Whether a second pod may start while this node is lost: the table in docs/scheduling-rules.md, "One pod at a time"."""
        if self.on_disconnect or force not in LOSSES:
            return self.on_disconnect == "Failover" and force in LOSSES
        return "robot" not in node and not (force == "deleted node" and "Robot" in self.runs_on)


KINDS: Final = (
    Kind(("Edge",)),
    Kind(("Edge",), "Keep"),
    Kind(("Edge",), "Stop"),
    Kind(("Robot", "Edge")),
    Kind(("Robot", "Edge"), "Failover"),
    Kind(("Robot", "Edge"), "Stop"),
)
LOSSES: Final = ("silent node", "deleted node")
FORCES: Final = ("delete", "evict", "drain", "edit", *LOSSES)


# --- The judge --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Overlap:
    """At this revision a second pod of the component was on a node while `nodes[0]` had one that may still run."""

    revision: int
    app: str
    nodes: tuple[str, str]
    pods: tuple[str, str]


@dataclass(slots=True)
class Count:
    """`pods`: per app, the uids of pods that were on a node."""

    pods: dict[str, list[str]] = field(default_factory=dict)
    overlaps: list[Overlap] = field(default_factory=list)


def count(events: Iterable[Event]) -> Count:
    """A pod may run from its binding on until its object is gone, or its phase tells that all containers have ended.

    So a pod that is being deleted counts, also one on a node that cannot be reached.
    """
    found = Count()
    running: dict[str, dict[str, str]] = {}
    """By app, nodes by uid."""
    for event in sorted(event for event in events if event.kind == "Pod"):
        labels = event.obj["metadata"].get("labels", {})
        if labels.get(Label.COMPONENT.value) != COMPONENT:
            continue
        app, node = labels[Label.APP.value], event.obj["spec"].get("nodeName", "")
        here = running.setdefault(app, {})
        if event.gone or not node or event.obj["status"].get("phase") in ENDED:
            here.pop(event.uid, None)
            continue
        if event.uid not in here:
            found.pods.setdefault(app, []).append(event.uid)
            found.overlaps += [
                Overlap(event.revision, app, (before, node), (uid, event.uid)) for uid, before in here.items()
            ]
        here[event.uid] = node
    return found


# --- The campaign -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Replacement:
    """`revisions`: of the store before it and after it. `lost`: the node that could not be reached meanwhile."""

    app: str
    kind: Kind
    force: str
    old: str
    new: str
    seconds: float
    lost: str
    revisions: tuple[int, int]


@dataclass(slots=True)
class Report:
    replacements: list[Replacement] = field(default_factory=list)
    overlaps: list[Overlap] = field(default_factory=list)
    """Against what `onDisconnect` promises."""
    promised: list[Overlap] = field(default_factory=list)
    """Of components that fail over, while the node of the first pod was lost: two may run."""
    gaps: list[str] = field(default_factory=list)
    revisions: int = 0

    @property
    def by_force(self) -> Mapping[str, int]:
        return Counter(each.force for each in self.replacements)

    @property
    def problems(self) -> list[str]:
        return [*(f"overlap: {each}" for each in self.overlaps), *self.gaps]


def lanes_of(number: int) -> list[topology.SimulatedNode]:
    """The nodes of a lane: a zone of its own with two robots and two servers."""
    common: dict[str, Any] = {"zone": f"lane-{number}", "labels": {LANE: str(number)}}
    return [
        *(topology.robot(f"lane-{number}-robot-{each}", **common) for each in (1, 2)),
        *(topology.edge(f"lane-{number}-edge-{each}", **common) for each in (1, 2)),
    ]


class Lane:
    """One app, whose only pod is replaced by force."""

    def __init__(self, cp: ControlPlane, namespace: str, number: int, *, seed: int) -> None:
        self.name = f"lane-{number}"
        self.kind = KINDS[number % len(KINDS)]
        self.nodes = topology.Topology(lanes_of(number))
        self._number = number
        self._cp = cp
        self._tenant = Tenant(cp, namespace)
        self._fleet = Fleet(cp, self.nodes, self._tenant, seed=seed)
        self._chance = random.Random(f"{seed}/{number}")
        self._edits = 0

    def start(self) -> None:
        self._tenant.apply(self.name, self._component(), connectivity={"grace": f"{GRACE_S}s"})
        self._tenant.wait_ready(self.name, timeout_s=PATIENCE_S)

    def replace(self, force: str) -> Replacement:
        """Have the pod replaced, and wait until its successor is ready and alone."""
        began_s, before = time.monotonic(), self._revision()
        old = self._held_back(slow=force not in LOSSES)
        uid, node = old["metadata"]["uid"], old["spec"]["nodeName"]
        lost = node if force in LOSSES else ""
        if lost:
            self._without(old, force)
        else:
            slow = threading.Thread(target=self._ends_slowly, args=(old, self._chance.uniform(0, MOST_SLOW_S)))
            slow.start()
            self._force(force, old)
            slow.join()
        new = eventually(lambda: self._successor(uid), timeout_s=PATIENCE_S, what=self._pods)
        return Replacement(
            self.name, self.kind, force, uid, new, time.monotonic() - began_s, lost, (before, self._revision())
        )

    def _held_back(self, *, slow: bool) -> dict[str, Any]:
        """The pod that is to be replaced. slow: with the finalizer.

        The node lifecycle controller may be late and evict once more: then it is the next pod.
        """
        while True:
            pod: dict[str, Any] = eventually(self._calm, timeout_s=PATIENCE_S, what=self._pods)
            try:
                if slow:
                    self._cp.api.patch(self._path(pod["metadata"]["name"]), {"metadata": {"finalizers": [SLOW]}})
            except ApiStatusError as error:
                if error.status not in (404, 422):
                    raise
            else:
                return pod

    def _component(self) -> dict[str, Any]:
        written = {"onDisconnect": self.kind.on_disconnect} if self.kind.on_disconnect else {}
        template = {"spec": {"nodeSelector": {LANE: str(self._number)}}}
        return part(COMPONENT, runsOn=list(self.kind.runs_on), template=template, args=[str(self._edits)], **written)

    def _revision(self) -> int:
        return int(self._cp.api.get("/api/v1/nodes?limit=1")["metadata"]["resourceVersion"])

    def _pods(self) -> list[dict[str, Any]]:
        """Those on nodes, ending ones included."""
        pods = self._tenant.listed("pods")
        mine = [pod for pod in pods if pod["metadata"]["labels"].get(Label.APP.value) == self.name]
        return [pod for pod in mine if pod["spec"].get("nodeName")]

    def _calm(self) -> dict[str, Any]:
        """The only pod when it is ready and stays; else {}."""
        pods = self._pods()
        if len(pods) != 1 or "deletionTimestamp" in pods[0]["metadata"]:
            return {}
        if "True" in _ready(pods[0]):
            return pods[0]
        self._told_again(pods[0])
        return {}

    def _told_again(self, pod: dict[str, Any]) -> None:
        """A kubelet tells again that its pod is ready, which the node controller may have marked late; kwok tells it once."""
        node = self._cp.api.get(f"/api/v1/nodes/{pod['spec']['nodeName']}")
        if pod["status"].get("phase") == "Running" and "True" in _ready(node):
            conditions = [{"type": kind, "status": "True"} for kind in ("Ready", "ContainersReady")]
            path = f"{self._path(pod['metadata']['name'])}/status"
            self._cp.api.patch(path, {"status": {"conditions": conditions}}, content_type=STRATEGIC)

    def _another(self, old: str) -> bool:
        return any(pod["metadata"]["uid"] != old for pod in self._pods())

    def _successor(self, old: str) -> str:
        """The uid of the only pod when it is another one, ready and stays; else ""."""
        uid = str(self._calm().get("metadata", {}).get("uid", ""))
        return "" if uid == old else uid

    # Forces

    def _force(self, force: str, pod: dict[str, Any]) -> None:
        name, node = pod["metadata"]["name"], pod["spec"]["nodeName"]
        if force == "delete":
            self._delete(name)
        elif force == "edit":
            self._edits += 1
            self._tenant.edit(self.name, components=[self._component()])
        else:
            if force == "drain":
                self._cp.api.patch(f"/api/v1/nodes/{node}", {"spec": {"unschedulable": True}})
            self._evict(name)
            if force == "drain":
                eventually(lambda: self._successor(pod["metadata"]["uid"]), timeout_s=PATIENCE_S, what=self._pods)
                self._cp.api.patch(f"/api/v1/nodes/{node}", {"spec": {"unschedulable": None}})

    def _without(self, pod: dict[str, Any], force: str) -> None:
        """The node falls silent, or is deleted while its machine goes on, and comes back."""
        uid, node = pod["metadata"]["uid"], pod["spec"]["nodeName"]
        fails_over = self.kind.fails_over(node, force)
        if force == "silent node":
            self._fleet.ready(node, "Unknown")
        else:
            self._fleet.delete([node])
        try:
            if self.kind.on_disconnect == "Stop" and force == "silent node":
                eventually(lambda: self._ending(uid), timeout_s=PATIENCE_S, what=self._pods)
            elif not fails_over or force == "deleted node":
                self._delete(pod["metadata"]["name"])  # as a user does who has lost patience
            if fails_over:  # kwok may have ended the pod before it saw that its node is gone
                eventually(lambda: self._another(uid), timeout_s=PATIENCE_S, what=self._pods)
            else:
                time.sleep(AWAY_S)
        finally:
            if force == "silent node":
                self._fleet.ready(node, "True")
            else:
                self._fleet.bring([node])

    def _ends_slowly(self, pod: dict[str, Any], seconds: float) -> None:
        """The containers shut down for so long after they were told to."""
        eventually(lambda: self._ending(pod["metadata"]["uid"]), timeout_s=PATIENCE_S, what=self._pods)
        time.sleep(seconds)
        self._cp.api.patch(self._path(pod["metadata"]["name"]), {"metadata": {"finalizers": None}})

    def _ending(self, uid: str) -> bool:
        return any("deletionTimestamp" in pod["metadata"] for pod in self._pods() if pod["metadata"]["uid"] == uid)

    def _path(self, pod: str) -> str:
        return f"/api/v1/namespaces/{self._tenant.namespace}/pods/{pod}"

    def _delete(self, pod: str) -> None:
        try:
            self._cp.api.delete(self._path(pod))
        except ApiStatusError as error:
            if error.status != 404:
                raise

    def _evict(self, pod: str) -> None:
        body = {"apiVersion": "policy/v1", "kind": "Eviction", "metadata": {"name": pod}}
        self._cp.api.create(f"{self._path(pod)}/eviction", body)


def _ready(obj: Mapping[str, Any]) -> list[str]:
    return [each["status"] for each in obj["status"].get("conditions", ()) if each["type"] == "Ready"]


def run(
    cp: ControlPlane,
    namespace: str,
    *,
    replacements: int,
    lanes: int,
    seed: int,
    most_s: float = float("inf"),
    note: Callable[[Replacement], None] = lambda _: None,
) -> Report:
    """Replace so many pods on so many lanes at the same time; none is begun after `most_s`.

    Operator and scheduler run already; the nodes are made here.
    """
    until_s = time.monotonic() + most_s
    report, lock = Report(), threading.Lock()
    chance = random.Random(seed)
    tracks = [Lane(cp, namespace, number, seed=seed) for number in range(lanes)]
    planned = [FORCES[number % len(FORCES)] for number in range(replacements)]
    chance.shuffle(planned)

    def drive(lane: Lane) -> None:
        lane.start()
        while True:
            with lock:
                if not planned or time.monotonic() > until_s:
                    return
                force = planned.pop()
            try:
                found = lane.replace(force)
            except BaseException:
                planned.clear()
                raise
            with lock:
                report.replacements.append(found)
            note(found)

    nodes = [node for lane in tracks for node in lane.nodes]
    topology.apply(cp, nodes)
    try:
        with Recorder(cp) as recorder:
            eventually(lambda: recorder.passed.get("Pod", 0))
            with ThreadPoolExecutor(max_workers=lanes) as pool:
                list(pool.map(drive, tracks))
            items = cp.api.get(f"/api/v1/namespaces/{namespace}/pods")["items"]
            last = max(int(item["metadata"]["resourceVersion"]) for item in items)
            eventually(lambda: recorder.problems or recorder.passed["Pod"] >= last)
            events = recorder.ripe(all_of_them=True)
    finally:
        topology.remove(cp, nodes)
    report.revisions, report.gaps = recorder.revisions, list(recorder.problems)
    judge(report, count(events))
    return report


def judge(report: Report, found: Count) -> None:
    """Sort the overlaps by what was promised, and notice a watch that has not seen every pod."""
    for overlap in found.overlaps:
        allowed = any(_allowed(overlap, each) for each in report.replacements)
        (report.promised if allowed else report.overlaps).append(overlap)
    seen = {uid for pods in found.pods.values() for uid in pods}
    missed = {uid for each in report.replacements for uid in (each.old, each.new)} - seen
    if missed:
        report.gaps.append(f"the watch has not seen {len(missed)} pods")


def _allowed(overlap: Overlap, during: Replacement) -> bool:
    first, last = during.revisions
    same = during.app == overlap.app and first <= overlap.revision <= last
    return same and during.lost == overlap.nodes[0] and during.kind.fails_over(during.lost, during.force)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench replacements", description=__doc__)
    parser.add_argument("--count", type=options.count(1, 100_000), default=200, help="replacements in all")
    parser.add_argument("--lanes", type=options.count(1, 50), default=12, help="apps that are driven at the same time")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-minutes", type=options.count(1), default=60, help="begin no replacement after so long")
    parser.add_argument("--json", type=options.report, help="write every replacement and overlap to this file")
    arguments = parser.parse_args(argv)
    began_s = time.monotonic()
    with ControlPlane() as cp:
        product.install(cp)
        product.start_scheduler(cp, sweep_seconds=1)
        product.start_operator(cp, sweep_seconds=1, no_leader_election=True)
        with created(cp, "replacements") as namespace:
            report = run(
                cp,
                namespace,
                replacements=arguments.count,
                lanes=arguments.lanes,
                seed=arguments.seed,
                most_s=60.0 * arguments.most_minutes,
                note=_say,
            )
    print("\n".join(table(report)))
    print(f"{report.revisions} revisions watched, {time.monotonic() - began_s:.0f} s")
    save(arguments.json, asdict(report))
    for problem in report.problems:
        print(problem)
    return 1 if report.problems else 0


def table(report: Report) -> list[str]:
    """One line per force, and one for all."""
    lines = [f"{'force':14}{'replaced':>10}{'overlaps':>10}{'promised':>10}{'median s':>10}{'most s':>10}"]
    for force in (*FORCES, ""):
        of = [each for each in report.replacements if force in ("", each.force)]
        if not of:
            continue
        seconds = [each.seconds for each in of]
        within = [(each.app, *each.revisions) for each in of]
        overlaps, promised = (
            sum(any(app == one.app and first <= one.revision <= last for app, first, last in within) for one in found)
            for found in (report.overlaps, report.promised)
        )
        figures = f"{len(of):>10}{overlaps:>10}{promised:>10}{statistics.median(seconds):>10.1f}{max(seconds):>10.1f}"
        lines.append(f"{force or 'all':14}{figures}")
    return lines


def _say(found: Replacement) -> None:
    kind = f"{'/'.join(found.kind.runs_on)} {found.kind.on_disconnect or 'default'}"
    print(f"{found.app:8} {kind:22} {found.force:12} {found.seconds:5.1f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
