"""What the scheduler tries out in its cache leaves no trace: rows, indexes, counts and the change log are as before."""

from contextlib import suppress
from random import Random
from typing import Any, Final

import msgspec
import pytest
from tests.property.core.memory.cache_dump import differences, dump
from tests.support.scheduler.pod_groups import announce, arrive, pod_group, team_pod
from tests.support.scheduling import app_object, chain, make_core, make_info, make_node, make_pod, member_pod

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.disruption_budgets import DisruptionBudget
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cycle.all_or_nothing import all_or_none
from robotapp_scheduler.core.cycle.re_evaluate import re_evaluate
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo

HOSTNAME, ZONE = "kubernetes.io/hostname", "zone"
NODES: Final = 5
IN_THE_LIVE_LOG: Final = (".log.", ".topology._log.", ".topology._wide_position", ".resource_claims._log.")
"""Where moves that are not a dry run of preemption are written: the entries of a move and of its undoing."""


class BrokenError(Exception):
    """Raised in the middle of a dry run."""


def term(random: Random) -> dict[str, Any]:
    key = HOSTNAME if random.random() < 0.6 else ZONE
    return {"topologyKey": key, "labelSelector": {"matchLabels": {"app": random.choice("ab")}}}


def fields(random: Random, *, priority: int) -> dict[str, Any]:
    """Fields of a pod that other pods may matter to: affinity, spread, host ports, volumes."""
    cpu = random.choice(["500m", "1", "2"])
    found: dict[str, Any] = {"priority": priority, "labels": {"app": random.choice("abc")}, "cpu": cpu}
    if random.random() < 0.3:
        ports = [{"containerPort": 80, "hostPort": random.choice([80, 81])}]
        found["containers"] = [{"name": "c", "resources": {"requests": {"cpu": cpu}}, "ports": ports}]
    if random.random() < 0.5:
        kind = random.choice(["podAffinity", "podAntiAffinity", "podAntiAffinity"])
        found["affinity"] = {kind: {"requiredDuringSchedulingIgnoredDuringExecution": [term(random)]}}
    if random.random() < 0.2:
        found["topologySpreadConstraints"] = [{**term(random), "maxSkew": 1, "whenUnsatisfiable": "DoNotSchedule"}]
    if random.random() < 0.3:
        disk = {"pdName": random.choice(["d0", "d1"]), "fsType": "ext4"}
        found["volumes"] = [{"name": "v", "gcePersistentDisk": disk}]
    return found


def budget(app: str, allowed: int) -> DisruptionBudget:
    spec = {"selector": {"matchLabels": {"app": app}}}
    status = {"disruptionsAllowed": allowed}
    return msgspec.convert(
        {"metadata": {"name": app, "namespace": "default"}, "spec": spec, "status": status}, DisruptionBudget
    )


def full_cluster(random: Random) -> SchedulerCore:
    """Nodes with pods of low priority, some ending, assumed or of an app; nominated pods that wait, and a budget."""
    core = make_core(*(make_node(f"n{i}", cpu="3", labels={ZONE: f"z{i % 2}"}) for i in range(NODES)))
    cluster = core.cluster
    cluster.apply_app(app_object({"name": "talker"}))
    for owner in chain("talker"):
        cluster.apply_owner(owner)
    for i in range(14):
        pod = make_pod(f"low{i}", node=f"n{i % NODES}", **fields(random, priority=random.choice([0, 0, 5])))
        if random.random() < 0.15:
            pod.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
        cluster.apply_pod(pod)
    cluster.apply_pod(member_pod("talker", uid="t1", node="n0", cpu="100m"))
    assumed = make_pod("assumed", **fields(random, priority=0))
    cluster.apply_pod(assumed)
    cluster.assume(PodInfo(assumed), "n1")
    for i in range(random.randrange(3)):
        waiting = make_info(f"wait{i}", **fields(random, priority=random.choice([3, 20])))
        cluster.apply_pod(waiting.pod)
        cluster.nominations.nominate(waiting, f"n{random.randrange(NODES)}")
    cluster.budgets.apply(budget("a", random.randrange(2)))
    return core


def moves(core: SchedulerCore, random: Random, dry_run: DryRun, pods: list[PodInfo]) -> None:
    """Take pods off and put pods on, return half-way at times, and ask the filters in between."""
    cluster = core.cluster
    for i in range(12):
        if random.random() < 0.5 and cluster.placed:
            dry_run.take(cluster.placed[random.choice(sorted(cluster.placed))])
        else:
            info = make_info(f"new{i}", **fields(random, priority=random.choice([0, 7])))
            dry_run.put(cluster.record(info, f"n{random.randrange(NODES)}"))
        if random.random() < 0.2:
            dry_run.back(random.randrange(dry_run.depth + 1))
        if random.random() < 0.3:
            info = random.choice(pods)
            core.runner(info.scheduler_name).evaluate(info, None)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("breaks", [False, True])
def test_any_moves_are_undone_after_errors_too(seed: int, *, breaks: bool) -> None:
    random = Random(seed)
    core = full_cluster(random)
    pods = [make_info(f"high{i}", **fields(random, priority=10)) for i in range(2)]
    before, log = dump(core.cluster), core.cluster.log
    with suppress(BrokenError), DryRun(core.cluster) as dry_run:
        moves(core, random, dry_run, pods)
        if breaks:
            raise BrokenError
    assert differences(before, dump(core.cluster)) == []
    assert core.cluster.log is log


@pytest.mark.parametrize("seed", range(60))
def test_an_attempt_that_preempts_changes_nothing(seed: int) -> None:
    random = Random(seed)
    core = full_cluster(random)
    for i in range(3):
        info = make_info(f"high{i}", **fields(random, priority=10))
        before = dump(core.cluster)
        core.schedule_one(info, assume=False)
        assert differences(before, dump(core.cluster)) == []


def test_some_of_these_attempts_do_move_pods(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[str] = []
    take = DryRun.take

    def seen(dry_run: DryRun, record: PlacedPod) -> None:
        taken.append(record.uid)
        take(dry_run, record)

    monkeypatch.setattr(DryRun, "take", seen)
    for seed in range(10):
        random = Random(seed)
        full_cluster(random).schedule_one(make_info("high", **fields(random, priority=10)), assume=False)
    assert taken


def team(random: Random, count: int) -> list[Pod]:
    pods = [team_pod(f"m{i}", cpu=random.choice(["1", "2"]), priority=10) for i in range(count)]
    for pod in pods:
        if random.random() < 0.3:
            pod.status.nominated_node_name = f"n{random.randrange(NODES)}"
    return pods


@pytest.mark.parametrize("seed", range(40))
def test_looking_for_evictions_for_a_group_changes_nothing_but_the_log(seed: int) -> None:
    random = Random(seed)
    core = full_cluster(random)
    announce(core, pod_group(min_member=4))
    pods = team(random, 4)
    for pod in pods:
        core.cluster.nominations.see(PodInfo(pod))
    arrive(core, *pods)
    refused = [core.schedule_one(PodInfo(pod), assume=False) for pod in pods]
    before = dump(core.cluster)
    all_or_none(core, refused)
    found = differences(before, dump(core.cluster))
    assert any(decision.plan for decision in refused) or not found
    assert [line for line in found if not line.startswith(IN_THE_LIVE_LOG)] == []


@pytest.mark.parametrize("seed", range(20))
def test_explaining_a_bound_pod_again_changes_nothing(seed: int) -> None:
    core = full_cluster(Random(seed))
    before = dump(core.cluster)
    for record in list(core.cluster.placed.values()):
        re_evaluate(core, record.pod)
    found = differences(before, dump(core.cluster))
    assert [line for line in found if not line.startswith(IN_THE_LIVE_LOG)] == []
