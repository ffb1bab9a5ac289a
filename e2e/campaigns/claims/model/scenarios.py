"""Every scenario of the claim protocol with the verdict it must get. `quick` ones run in scripts/test.

R, D and C: the rules as built (C: of devices as ResourceClaims, as they are to be built). E: weaker forms of what follows a restore of etcd. J: instances that are started again. P: weaker forms of parking. L: weaker forms in which something waits for ever. M, DM, CM and JM: mutants. U: unchecked pods.
All of them: `scripts/bench claims --all`, or `python -m campaigns.claims.claims --all`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from campaigns.claims import restarts
from campaigns.claims.model import device_rules as devices
from campaigns.claims.model import domain_mutants as mutants
from campaigns.claims.model import ledger_rules as ledgers
from campaigns.claims.model.device import DeviceModel
from campaigns.claims.model.device_rules import DeviceRules
from campaigns.claims.model.domain import DomainModel
from campaigns.claims.model.domain_rules import AUTO, NONE, DomainRules, JobRules
from campaigns.claims.model.explore import Model, Result, explore
from campaigns.claims.model.ledger import OURS, THEIRS, LedgerModel
from campaigns.claims.model.ledger_rules import LedgerRules
from campaigns.claims.restarts import RestartModel, RestartRules


@dataclass(frozen=True)
class Scenario:
    name: str
    about: str
    expect: frozenset[str]
    model: Callable[[], Model]
    live: bool
    quick: bool

    def __str__(self) -> str:
        return f"{self.name}: {self.about}"

    def run(self) -> Result:
        return explore(self.model(), live=self.live)


ALL: dict[str, Scenario] = {}


def domain(
    name: str,
    about: str,
    expect: str = "OK",
    rules: type[DomainRules] = DomainRules,
    *,
    live: bool = True,
    quick: bool = True,
    **sizes: Any,
) -> None:
    words = frozenset(expect.split("|"))
    ALL[name] = Scenario(name, about, words, lambda: DomainModel(rules=rules(), **sizes), live, quick)


def device(
    name: str,
    about: str,
    expect: str = "OK",
    rules: type[DeviceRules] = DeviceRules,
    *,
    quick: bool = True,
    **sizes: Any,
) -> None:
    words = frozenset(expect.split("|"))
    ALL[name] = Scenario(name, about, words, lambda: DeviceModel(rules=rules(), **sizes), live=True, quick=quick)


def ledger(
    name: str,
    about: str,
    expect: str = "OK",
    rules: type[LedgerRules] = LedgerRules,
    *,
    quick: bool = True,
    **sizes: Any,
) -> None:
    """Adds a scenario of devices as ResourceClaims."""
    words = frozenset(expect.split("|"))
    ALL[name] = Scenario(name, about, words, lambda: LedgerModel(rules=rules(), **sizes), live=True, quick=quick)


def restart(name: str, about: str, expect: str = "OK", rules: type[RestartRules] = RestartRules, **sizes: Any) -> None:
    """Adds a scenario of an instance that is started again."""
    words = frozenset(expect.split("|"))
    ALL[name] = Scenario(name, about, words, lambda: RestartModel(rules=rules, **sizes), live=True, quick=True)


ONE: dict[str, Any] = {"ids": 1, "specs": (AUTO, NONE)}
"""Two apps, one id."""
SOLO: dict[str, Any] = {"apps": (0,), "names": (0,), "begin": "L", "wants": (AUTO,)}
"""One app, two ids."""
PAIR: dict[str, Any] = {"apps": (0, 0), "begin": "L", "specs": (AUTO, NONE)}
"""Two instances of one app."""
AGAIN: dict[str, Any] = {"begin": "LN", "names": (0, 0), "specs": (AUTO, NONE)}
"""An app deleted and created again under its name."""

domain("R1", "2 apps, 1 id, 2 changes, 2 sweepers", quick=False, **ONE, changes=2, sweepers=2)
domain("R1s", "2 apps, 1 id, 1 change, 2 pods", **ONE, pods=2, apart=True)
domain("R2", "2 apps, 2 ids, 1 change", quick=False, pods=2)
domain("R3", "1 app, 2 ids, 2 changes", quick=False, **SOLO, changes=2)
domain("R3b", "1 app, 2 ids, 1 change, 2 sweepers", quick=False, **SOLO, sweepers=2)
domain("R3s", "1 app, 2 ids, 1 change", **SOLO, apart=True)
domain("R4", "2 instances, 2 ids, 1 change", quick=False, **PAIR, pods=2)
domain("R4s", "2 instances, 1 id, 1 change", **{**PAIR, "ids": 1}, pods=2, apart=True)
domain("R5", "app re-created under its name, 2 ids, 2 changes", quick=False, **AGAIN, changes=2, pods=2)
domain("R5s", "app re-created under its name, 1 id, 2 changes", **{**AGAIN, "ids": 1}, changes=2, pods=2, apart=True)
domain("R6", "deletions only, strict orphans, no template moves", quick=False, specs=(), pods=2)
domain("R6s", "deletions only, prompt controllers, no template moves", quick=False, specs=(), pods=2, lag=False)
domain("R6t", "deletions only, 1 id, prompt controllers", ids=1, specs=(), pods=2, lag=False)
domain("R1t", "2 apps, 1 id, 2 changes, prompt controllers", quick=False, **ONE, changes=2, pods=2, lag=False)
domain("R7", "a lone app never has two claims", **SOLO, changes=0, no_duplicates=True)
domain("R8", "forced template writes: still safe", "OK", mutants.Forced, quick=False, **ONE, changes=2)
domain("R9", "forced template writes move a running app", "FLAP", mutants.Forced, quick=False, specs=(), pods=2)
domain("R10", "scaled-down ReplicaSets are kept as history", **SOLO, history=True)
domain("R20s", "ids passed over on an old cache, 2 apps, 1 id", **ONE, pods=2, lag=False, old_cache=True)
domain("R23s", "components that end, 2 apps, 1 id, 1 change", rules=JobRules, **ONE, pods=2, lag=False)
domain("R23", "components that end, 2 apps, 1 id, 2 changes", rules=JobRules, quick=False, **ONE, changes=2)
domain("R24s", "jobs that have ended are kept, 1 app, 2 ids", rules=JobRules, **SOLO, history=True)

FORGED: dict[str, Any] = {"forgeries": 1}
"""An attacker writes one look-alike of anything, at any time, and leaves it."""
domain("R11", "attacker, 2 apps, 1 id, 1 change", quick=False, **ONE, **FORGED, pods=2)
domain("R11s", "attacker, 2 apps, 1 id, 1 change, prompt controllers", **ONE, **FORGED, pods=2, lag=False, operators=1)
domain("R12", "2 look-alikes, 2 apps, 1 id", quick=False, **ONE, forgeries=2, pods=2, lag=False, operators=1)
domain("R13", "attacker, 1 app, 2 ids, 2 changes", quick=False, **SOLO, **FORGED, changes=2, lag=False, operators=1)
domain("R13s", "attacker, 1 app, 2 ids, 1 change", quick=False, **SOLO, **FORGED, operators=1)
domain(
    "R14",
    "attacker, app re-created under its name, 1 id",
    quick=False,
    **{**AGAIN, "ids": 1},
    **FORGED,
    changes=2,
    pods=2,
    operators=1,
)
for number, about, expect, weak in (
    ("A1", "labels prove whose object it is", "STUCK", mutants.LabelsProve),
    ("A2", "owner references are believed", "STUCK", mutants.OwnersUnchecked),
    ("A3", "repairs for whoever says so", "FORGED", mutants.RepairsByLabel),
):
    domain(number, about, expect, weak, **ONE, **FORGED, pods=2, lag=False, operators=1)

AWAY: dict[str, Any] = {"vanishings": 1, "pods": 2, "lag": False, "operators": 1}
"""A robot's node vanishes with its pod objects, while its containers run on."""
domain("R15", "a robot out of sight, 2 apps, 1 id, 1 change", quick=False, **ONE, vanishings=1, pods=2)
domain("R15s", "a robot out of sight, 2 apps, 1 id, 1 change, prompt controllers", **ONE, **AWAY)
domain("R16", "out of sight twice, 2 apps, 1 id, 2 changes", quick=False, **ONE, **{**AWAY, "vanishings": 2}, changes=2)
domain("R17s", "a robot out of sight, 1 app, 2 ids, 1 change", **SOLO, **AWAY)
domain(
    "R17", "out of sight twice, 1 app, 2 ids, 2 changes", quick=False, **SOLO, **{**AWAY, "vanishings": 2}, changes=2
)
domain("R18", "out of sight, app re-created, 1 id", quick=False, **{**AGAIN, "ids": 1}, **AWAY, changes=2)
domain("R19", "out of sight, 2 sweepers", quick=False, **ONE, **AWAY, sweepers=2)
for number, about, expect, weak in (
    ("P1", "never parked", "LOST|DOUBLE", mutants.NeverParked),
    ("P2", "nodes are not noted before the bind", "LOST|DOUBLE", mutants.NodeNotNoted),
    ("P4", "bind on a parked claim", "LOST|DOUBLE", mutants.BindOnParked),
):
    domain(number, about, expect, weak, **ONE, **AWAY)
domain("P3", "a node is noted once", "LOST|DOUBLE", mutants.NodeNotedOnce, **ONE, **AWAY)
LONE: dict[str, Any] = {**SOLO, **AWAY, "ids": 1, "specs": (AUTO, NONE)}
domain("P5", "a confirmation holds for ever", "LOST|DOUBLE", mutants.ConfirmedForEver, **LONE)
domain("R17t", "out of sight and wanted again, 1 app, 1 id, 3 changes", quick=False, **LONE, changes=3)

BACKUP: dict[str, Any] = {"restores": 1, "pods": 2, "lag": False, "operators": 1}
"""etcd is restored from a snapshot that was taken at any time before."""
domain("R21s", "etcd restored, 2 apps, 1 id, no changes", specs=(), ids=1, **BACKUP, changes=0)
domain("R21", "etcd restored, 2 apps, 1 id, 1 change", quick=False, **ONE, **BACKUP)
domain("R22", "etcd restored, 1 app, 2 ids, 1 change", quick=False, **SOLO, **BACKUP)
ALONE_BACKUP: dict[str, Any] = {**SOLO, **BACKUP, "ids": 1, "specs": (AUTO, NONE)}
for number, about, expect, weak in (
    ("E1", "ids granted since the snapshot are free", "LOST|DOUBLE", mutants.LostClaimsForgotten),
    ("E2", "nodes of claims that stand are not noted again", "LOST|DOUBLE", mutants.LostNodesForgotten),
    ("E3", "what was decided before a restore is carried out after it", "LOST|DOUBLE", mutants.GoesOn),
):
    domain(number, about, expect, weak, **ALONE_BACKUP)

domain("U1", "no bind check", "DOUBLE", mutants.NoBindCheck, live=False, **ONE, lag=False, pods=2, only="DOUBLE")
domain(
    "U2",
    "no bind check, forced writes",
    "DOUBLE",
    mutants.ForcedNoBindCheck,
    live=False,
    **ONE,
    lag=False,
    pods=2,
    only="DOUBLE",
)
domain("U3", "no bind check, any lost claim counts", "LOST|DOUBLE", mutants.NoBindCheck, live=False, **ONE, pods=2)

domain("L1", "history counts as use", "STUCK", mutants.HistoryCounts, **SOLO, history=True)
domain("L1j", "jobs that have ended count as use", "STUCK", mutants.EndedJobsCount, **SOLO, history=True)
domain("L2", "any child keeps all claims", "STUCK", mutants.AnyChildKeepsAll, **SOLO)
domain("L3", "bind check by owner chain", "STUCK", mutants.OwnerChain, quick=False, specs=(), pods=2)
domain("L3s", "bind check by owner chain, 1 id", "STUCK", mutants.OwnerChain, ids=1, specs=(), pods=2, lag=False)
domain("L4", "templates with an unheld id stay", "STUCK", mutants.UnheldStays, quick=False, pods=2)
domain(
    "L4s",
    "templates with an unheld id stay, 1 id",
    "STUCK",
    mutants.UnheldStays,
    **ONE,
    changes=2,
    pods=2,
    lag=False,
    operators=1,
)

domain("M1", "create without LIST", "FLAP|STUCK", mutants.NoList, specs=(), pods=2, lag=False, operators=1)
domain("M2", "random order of ids", "DUP", mutants.RandomOrder, **SOLO, changes=0, no_duplicates=True)
# Deployments keep an id for their app, which wants it anyway; for orphans live pods alone do (A1).
domain(
    "M3",
    "pods alone count as use: no harm behind the bind check",
    "OK",
    mutants.PodsOnly,
    quick=False,
    specs=(),
    pods=2,
)
domain(
    "M3j",
    "jobs do not count as use, no bind check",
    "LOST|DOUBLE",
    type("JobsNotListedUnchecked", (mutants.JobsNotListed, mutants.NoBindCheck), {}),
    live=False,
    **ONE,
    pods=2,
)
domain(
    "M3s",
    "pods alone count as use, no bind check",
    "DOUBLE",
    type("PodsOnlyUnchecked", (mutants.PodsOnly, mutants.NoBindCheck), {}),
    live=False,
    **ONE,
    pods=2,
    lag=False,
    only="DOUBLE",
)
domain("M4", "no second look after the quarantine", "LOST", mutants.NoSecondLook, **ONE)
domain("M5", "release in one phase", "LOST", mutants.OnePhase, **ONE)
domain("M6", "403 taken for gone", "LOST", mutants.ForbiddenIsGone, **ONE)
domain("M7", "delete with the uid only", "LOST", mutants.UidOnly, **ONE)
domain("M8", "delete by name", "LOST", mutants.ByName, **ONE, sweepers=2)
domain("M9", "pods listed before the claims", "LOST", **ONE, sweepers=2, pods_first=True)
domain("M10", "bind on a Draining claim", "LOST", mutants.BindOnDraining, **ONE)
domain("M14", "bind check older than the pod", "LOST", **ONE, cached_check=True)

device("D0", "1 device, 2 + 1 pods, 2 schedulers, 2 sweepers")
device("D1", "1 device, 3 + 1 pods, 2 schedulers, 2 sweepers", quick=False, holders=(0, 0, 0, 1))
device("D2", "1 device, 2 + 2 pods", quick=False, holders=(0, 0, 1, 1))
device("D3", "2 devices, 2 + 1 pods", quick=False, devices=2)
device("D4", "2 devices, 3 apps", quick=False, devices=2, holders=(0, 1, 2), groups=(0, 1, 2))
device("D5", "2 instances of one component", groups=(0, 0))
device("D6", "a pod that cannot have the rest gives its device back: fence, then release", gives_back=True)
device("D7", "the same with 2 devices", quick=False, devices=2, gives_back=True)
device("DM1", "whoever comes may take a Draining device", "LOST|DOUBLE", devices.Anyone, groups=(0, 0))
device("DM2", "delete with the uid only", "LOST", devices.UidOnly)
device("DM3", "take over without the version", "LOST|DOUBLE", devices.NoCompare)
device("DM4", "freed with its app while the pod terminates", "LOST", devices.FreedWithItsApp)
device("DM5", "a terminating pod counts as gone", "LOST|DOUBLE", devices.TerminatingIsGone)
device("DM7", "given back without the fence", "LOST|DOUBLE", gives_back=True, fences=False)
device("DM6", "Unreserve after a binding without answer", "LOST", unreserve=True)

device("D8", "attacker, 2 + 1 pods", forgeries=1, sweepers=1)
device("D9", "2 look-alikes, 2 instances of one component", quick=False, groups=(0, 0), forgeries=2)
device("D10", "attacker, 2 devices", quick=False, devices=2, holders=(0, 1), forgeries=1, sweepers=1)
device("D11", "attacker, a pod gives its device back", quick=False, gives_back=True, forgeries=1)
for number, about, expect, seeded in (
    ("DA1", "labels prove whose pod it is", "FORGED", devices.LabelsProve),
    ("DA2", "whatever wears the labels is a predecessor", "STUCK", devices.LabelsHoldBack),
    ("DA3", "owner references are believed across namespaces", "FORGED", devices.OwnersUnchecked),
):
    device(number, about, expect, seeded, forgeries=1, sweepers=1)

RACE: dict[str, Any] = {"schedulers": (OURS, THEIRS), "theirs": (1,), "stops": False}
"""Our scheduler and kube-scheduler, each with the pods of one app."""
TWO_SPARE: dict[str, Any] = {**RACE, "holders": (0, 1), "devices": 2}
CALM: dict[str, Any] = {"stops": False}
LONE_SCHEDULER: dict[str, Any] = {"schedulers": (OURS,)}
ledger("C0", "claims, 1 device, 1 + 1 pods, 1 scheduler", **LONE_SCHEDULER, holders=(0, 1))
ledger("C1", "claims, 1 device, 2 + 1 pods, 1 scheduler", quick=False, **LONE_SCHEDULER)
ledger("C2", "claims, 1 device, 1 + 1 pods, 2 schedulers", quick=False, holders=(0, 1))
ledger("C3", "claims, 1 device, 2 + 1 pods, 2 schedulers, no app ends", **CALM)
ledger("C4", "claims, beside kube-scheduler, no app ends", **RACE)
ledger("C5", "claims, beside kube-scheduler, 2 preparations at once, no app ends", **RACE, calls=2)
ledger("C6", "claims, beside kube-scheduler, 2 devices", **TWO_SPARE)
ledger("C7", "claims, beside kube-scheduler, apps end", quick=False, **{**RACE, "stops": True})
ledger("C8", "claims, pods deleted by force", quick=False, **CALM, forces=True)
ledger("C9", "claims, beside kube-scheduler, pods deleted by force", quick=False, **RACE, forces=True)
ledger("C10", "claims, 2 schedulers, 2 + 1 pods, apps end", quick=False)
ledger("C11", "claims, 2 devices, 3 apps", quick=False, **CALM, holders=(0, 1, 2), devices=2)
for number, about, expect, unsafe, sizes in (
    ("CM1", "the lock ends with the pod", "RIVAL", ledgers.LockEndsWithThePod, RACE),
    ("CM2", "no lock", "RIVAL|DOUBLE", ledgers.NoLock, RACE),
    ("CM3", "a successor joins while its predecessor terminates", "SAME", ledgers.SuccessorJoins, CALM),
    ("CM4", "no standing consumer", "RIVAL", ledgers.NoStandingConsumer, CALM),
    ("CM5", "emptied while a pod exists", "LOST", ledgers.ReleasedUnderPods, LONE_SCHEDULER),
    ("CM6", "the app is read before the claim", "RIVAL", ledgers.AppReadFirst, LONE_SCHEDULER),
    ("CM7", "unconditional writes", "SAME|LOST", ledgers.NoCompare, CALM),
    ("CM8", "given back before its pod is gone", "LOST", ledgers.FreedBeforeItsPod, RACE),
    ("CM9", "locked after the reply", "RIVAL|DOUBLE", ledgers.LockedAfterwards, RACE),
    ("CM10", "refused pods of others are left alone", "STUCK", ledgers.OwnPodsOnly, TWO_SPARE),
    ("CM11", "bound before the claim is written", "SAME", ledgers.BoundFirst, CALM),
    ("CM12", "the app is read before the pods", "RIVAL", ledgers.AppReadBeforePods, LONE_SCHEDULER),
    ("CM13", "consumers that are gone stay", "RIVAL", ledgers.OldRefusals, RACE),
    ("CM14", "two preparations beside each other", "RIVAL", ledgers.LockChangedUnseen, {**RACE, "calls": 2}),
):
    ledger(number, about, expect, unsafe, **sizes)

restart("J1", "2 jobs, 1 restart")
restart("J2", "1 job, 2 restarts", jobs=1, max_restarts=2)
restart("J3", "2 jobs, 1 restart, 2 operators", operators=2, counts=False)
restart("JM1", "a failed job ends the instance for the sweep", "EARLY", restarts.EndsWithAFailure)
restart("JM2", "jobs of earlier attempts decide as well", "EARLY", restarts.EveryAttemptCounts)
restart("JM3", "jobs are replaced without a record", "MANY", restarts.NothingRecorded, jobs=1)

IN_TURN = (
    *("CM5", "CM6", "CM12", "C3", "C5"),
    *("R3s", "R4s", "R5s", "R11s", "R15s", "R17s", "R20s", "L4s", "M8", "D8", "DA2", "A1"),
    *("R1s", "R10", "A2", "U2", "M1", "P2", "P3", "P4", "L1"),
)
"""Quick ones that take most of a second or more: scripts/test runs a ninth of them a day, `scripts/bench claims` all."""
