"""The product and the scalar reference on one case: every way in which their decisions differ, in words.

Compared are the text, the feasible nodes, each refused node's first failing plugin with its reasons and whether they
are final, raw, normalised and total scores, the choice, and what preemption proposes.
"""

from collections.abc import Mapping
from typing import Any

import msgspec
from tests.support.scheduling import make_core, to_node, to_pod

from campaigns.cluster_cases import Case
from campaigns.reference_scheduler import Config, Decision, decide
from campaigns.reference_scheduler.filtering import OUTSIDE
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.api import storage_v1
from robotapp_scheduler.core.api.core_v1 import Namespace, Selecting
from robotapp_scheduler.core.cache.disruption_budgets import DisruptionBudget
from robotapp_scheduler.core.cycle.diagnosis import QUIRK
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult as Found
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.evaluation import Evaluation

Json = dict[str, Any]


def feed(core: SchedulerCore, kind: str, item: Json, *, remove: bool = False) -> None:
    """One object, as the product's watches bring it. Kinds the product does not watch yet are left out."""
    cluster = core.cluster
    if kind == "Node" and remove:
        cluster.remove_node(item["metadata"]["name"])
    elif kind == "Node":
        cluster.apply_node(to_node(item))
    elif kind == "Pod":
        pod = to_pod(item)
        if pod.spec.node_name:
            (cluster.remove_pod if remove else cluster.apply_pod)(pod)
        elif remove:
            cluster.nominations.discard(pod.metadata.uid)
        else:
            cluster.nominations.see(PodInfo(pod))
    elif kind == "PodDisruptionBudget":
        cluster.budgets.apply(msgspec.convert(item, DisruptionBudget))
    elif kind == "Namespace":
        cluster.topology.apply_namespace(msgspec.convert(item, Namespace))
    elif kind in SELECTING:
        cluster.topology.apply_selecting(kind, msgspec.convert(item, Selecting))
    elif kind == "ResourceClaim":
        cluster.resource_claims.apply_claim(msgspec.convert(item, ResourceClaim))
    elif kind in STORAGE:
        as_type, name = STORAGE[kind]
        getattr(cluster.volumes, f"apply_{name}")(msgspec.convert(item, as_type))


def build(case: Case, args: Mapping[str, Json] | None = None) -> tuple[SchedulerCore, PodInfo]:
    """The product with the case's cluster in its cache; `args` are plugin arguments by plugin name."""
    core = make_core(args=args)
    objects = case.cluster.objects()
    for kind in ("Node", *(kind for kind in objects if kind != "Node")):
        for item in objects[kind]:
            feed(core, kind, item)
    pod = PodInfo(to_pod(case.pod))
    core.cluster.nominations.see(pod)
    return core, pod


STORAGE: Mapping[str, tuple[type, str]] = {
    "PersistentVolumeClaim": (storage_v1.Claim, "claim"),
    "PersistentVolume": (storage_v1.PersistentVolume, "volume"),
    "StorageClass": (storage_v1.StorageClass, "class"),
    "CSINode": (storage_v1.CSINode, "csi_node"),
    "CSIDriver": (storage_v1.CSIDriver, "driver"),
    "CSIStorageCapacity": (storage_v1.CSIStorageCapacity, "capacity"),
    "VolumeAttachment": (storage_v1.VolumeAttachment, "attachment"),
}
"""Kind to the product's type and the name of its watch."""
SELECTING = ("Service", "ReplicationController", "ReplicaSet", "StatefulSet")


def differences(case: Case, *, config: Config | None = None, args: Mapping[str, Json] | None = None) -> list[str]:
    """Empty when product and reference agree on the case; `config` and `args` say the same to either."""
    core, pod = build(case, args)
    return compare(core, pod, decide(case.cluster, case.pod, config or Config()))


def compare(core: SchedulerCore, pod: PodInfo, expected: Decision) -> list[str]:
    found = core.schedule_one(pod, assume=False)
    if expected.error:
        return [] if found.code is Code.ERROR else [f"no scheduling error, expected {expected.error!r}"]
    if found.code is Code.ERROR:
        return [f"scheduling error {found.message!r}"]
    unequal = [*_choice(found, expected), *_text(found, expected, is_member=pod.member is not None)]
    engine = core.runner(SCHEDULER_NAME)
    narrowed = engine.pre_filter(pod)
    if narrowed.status is not None or expected.refused is not None:
        if (narrowed.status is None) is not (expected.refused is None):
            unequal.append(f"PreFilter: {narrowed.status} instead of {expected.refused}")
        return unequal
    _, evaluation = core.consider(pod, engine)
    if expected.promised:
        return unequal
    if evaluation is None:
        return [*unequal, "no node was evaluated"]
    unequal += _mask(core, evaluation, expected)
    if not unequal and len(expected.feasible) > 1:
        engine.score(pod, evaluation)
        unequal += _scores(core, evaluation, expected)
    return unequal


def _choice(found: Found, expected: Decision) -> list[str]:
    if not expected.feasible:
        return [f"chose {found.node}, nothing is feasible"] if found.node is not None else []
    if found.node not in expected.best:
        return [f"chose {found.node}, best are {sorted(expected.best)}"]
    return []


def _text(found: Found, expected: Decision, *, is_member: bool) -> list[str]:
    """With several equally good places for a preemption any of them may be named. Pods of RobotApps are spared upstream's tail."""
    preemption = expected.preemption
    wanted = {expected.message.removesuffix(QUIRK) if is_member else expected.message}
    if preemption is not None and preemption.best:
        head = expected.message.removesuffix(preemption.tail)
        wanted = {(head + preemption.tail_for(node)).rstrip() for node in preemption.best}
    if found.message not in wanted:
        return [f"text {found.message!r}, expected {' or '.join(map(repr, sorted(wanted)))}"]
    if found.plan is None or preemption is None:
        return []
    victims = [victim.uid for victim in found.plan.victims]
    if found.nominate not in preemption.best:
        return [f"nominated {found.nominate}, best are {sorted(preemption.best)}"]
    if victims != preemption.victims[found.nominate]:
        return [f"victims on {found.nominate} {victims}, expected {preemption.victims[found.nominate]}"]
    return []


def _mask(core: SchedulerCore, evaluation: Evaluation, expected: Decision) -> list[str]:
    """Nodes outside the PreFilter's choice are not among the rows; rows of nodes that are gone have a code below 0."""
    engine = core.runner(SCHEDULER_NAME)
    found = {}
    feasible = set()
    for position, code in enumerate(evaluation.reason):
        name = engine.name_of(evaluation, position)
        if code > 0:
            reason = evaluation.reasons.values[code]
            found[name] = (reason.plugin, tuple(sorted(reason.texts)), not reason.resolvable)
        elif code == 0:
            feasible.add(name)
    wanted = {
        name: (each.plugin, tuple(sorted(each.texts)), each.final)
        for name, each in expected.rejections.items()
        if each.texts != (OUTSIDE,)
    }
    unequal = [
        f"{name}: refused {found.get(name)}, expected {wanted.get(name)}"
        for name in sorted({*found, *wanted})
        if found.get(name) != wanted.get(name)
    ]
    if not unequal and feasible != set(expected.feasible):
        unequal.append(f"feasible {sorted(feasible)}, expected {sorted(expected.feasible)}")
    return unequal


def _scores(core: SchedulerCore, evaluation: Evaluation, expected: Decision) -> list[str]:
    """A plugin that is left out on one side must have scored 0 everywhere on the other."""
    engine = core.runner(SCHEDULER_NAME)
    positions = (evaluation.reason == 0).nonzero()[0]
    names = [engine.name_of(evaluation, int(position)) for position in positions]
    totals = dict(zip(names, evaluation.totals[positions].tolist(), strict=True))
    unequal = [f"totals {totals}, expected {expected.totals}"] if totals != expected.totals else []
    normalized = {}
    for column in evaluation.scores:
        if column.skipped:
            continue
        plugin = column.plugin.name
        normalized[plugin] = dict(zip(names, evaluation.score_of(column, positions), strict=True))
        raw = dict(zip(names, (column.raw_at(int(position)) for position in positions), strict=True))
        wanted = expected.raw.get(plugin, {})
        # PodTopologySpread keeps nothing before normalising: None.
        if any(raw[name] not in {value, None} for name, value in wanted.items()):
            unequal.append(f"raw {plugin} {raw}, expected {wanted}")
    for plugin in sorted({*normalized, *expected.normalized}):
        nothing = dict.fromkeys(names, 0)
        got, wanted = normalized.get(plugin, nothing), expected.normalized.get(plugin, nothing)
        if got != wanted:
            unequal.append(f"normalised {plugin} {got}, expected {wanted}")
    return unequal
