"""State of the domain model, its bounds, and who falls back to idle when an object changes."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from campaigns.claims.model.domain_rules import AUTO, NONE, PARKED, RESERVED, DomainRules, Forged, Instance
from campaigns.claims.model.explore import Move

IDLE = ("idle",)
RESTING: tuple[Any, ...] = (-1, 0, 0, 0, (), NONE)
LIVE, DELETED, ORPHANED, TO_COME = "LGON"
DEPLOYMENT, REPLICA_SET, POD = "DSP"
PENDING, CHECKED, RUNNING, TERMINATING = "PCRT"


class State(NamedTuple):
    changes: int
    """Changes people may still make."""
    apps: tuple[str, ...]
    wants: tuple[int, ...]
    claims: tuple[tuple[int, int] | None, ...]
    """Per id: (instance, phase)."""
    deployments: tuple[tuple[int, int, int] | None, ...]
    """Per name: (instance, named id, wanted pods)."""
    sets: tuple[int, ...]
    """ReplicaSet per instance and id: 0 absent, 1 wants a pod, 2 scaled down and kept as history."""
    pods: tuple[tuple[int, int, str], ...]
    manager: tuple[Any, ...] | None
    """A write of the controller-manager, decided on an older view."""
    operators: tuple[tuple[Any, ...], ...]
    sweepers: tuple[tuple[Any, ...], ...]
    """(id, stage, instance, phase, ids the instance held, id its Deployment named)."""
    forged: tuple[tuple[str, int, int, str], ...] = ()
    """What an attacker has written and never takes away: (kind, instance it imitates, id, how)."""
    away: tuple[int, ...] = ()
    """Instances whose node is out of sight."""
    vanishings: int = 0
    """Times a node may still vanish."""
    noted: tuple[int, ...] = ()
    """Ids whose claim names the node of its holder."""
    unlisted: tuple[tuple[int, int], ...] = ()
    """(instance, id) of containers that run on while no pod object says so any more."""
    confirmed: tuple[int, ...] = ()
    """Ids of whose claim an admin has said that nothing runs on it."""
    restores: int = 0
    """Times etcd may still be restored from a snapshot."""
    snapshot: tuple[Any, ...] = ()
    """(apps, wants, claims, deployments, sets, pods, noted) as a snapshot of etcd has them; () before it is taken."""


FIELD = {name: index for index, name in enumerate(State._fields)}


def move(s: State, label: str, progress: bool, /, **changed: Any) -> Move:
    parts = [*s]
    for name, value in changed.items():
        parts[FIELD[name]] = value
    return label, progress, tuple.__new__(State, parts)  # _make is a call more, and this is where the time goes


def put(items: tuple[Any, ...], index: int, value: Any) -> tuple[Any, ...]:
    return (*items[:index], value, *items[index + 1 :])


def swap(items: tuple[Any, ...], old: Any, new: Any = None) -> tuple[Any, ...]:
    """Sorted, with `old` taken out and `new` put in where given."""
    found = list(items)
    if old is not None:
        found.remove(old)
    if new is not None:
        found.append(new)
    return tuple(sorted(found))


@dataclass
class Basis:
    """apps and names: RobotApp and Deployment of each instance. specs: values people may write to `ros2.domain`."""

    apps: tuple[int, ...] = (0, 1)
    names: tuple[int, ...] = (0, 1)
    begin: str = "LL"
    wants: tuple[int, ...] = (AUTO, AUTO)
    specs: tuple[int, ...] = (AUTO, NONE, 0, 1)
    ids: int = 2
    changes: int = 1
    operators: int = 2
    sweepers: int = 1
    pods: int = 3
    lag: bool = True
    history: bool = False
    apart: bool = False
    """The sweep reads claims and Deployments in two steps instead of one."""
    pods_first: bool = False
    """Structure mutant: the sweep lists pods before it reads the claims."""
    cached_check: bool = False
    """Structure mutant: the bind check may have been read before the pod existed."""
    old_cache: bool = False
    """Operators may pass over an id, because a cache of theirs still shows it in the hands of another."""
    forgeries: int = 0
    """Objects the attacker may write."""
    vanishings: int = 0
    """Times a node may vanish. Every instance has a node of its own."""
    restores: int = 0
    """Times etcd may be restored from a snapshot that was taken at any time before."""
    no_duplicates: bool = False
    only: str = ""
    rules: DomainRules = field(default_factory=DomainRules)

    def __post_init__(self) -> None:
        self.fenced = self.rules.fenced()
        self.precondition = self.rules.precondition()
        self.who: tuple[Instance, ...] = tuple((app, number) for number, app in enumerate(self.apps))
        self.all_ids = tuple(range(self.ids))
        self.follows_nodes = bool(self.vanishings or self.restores)

    def start(self) -> State:
        nothing = (None,) * (max(self.names) + 1)
        sets = (0,) * (len(self.names) * self.ids)
        return State(
            self.changes,
            tuple(self.begin),
            self.wants,
            (None,) * self.ids,
            nothing,
            sets,
            (),
            None,
            (IDLE,) * self.operators,
            (RESTING,) * self.sweepers,
            vanishings=self.vanishings,
            restores=self.restores,
        )

    # Helpers: who falls back to idle when an object changes

    def _state(self, s: State, h: int) -> str:
        return s.apps[self.apps[h]]

    def _own(self, s: State, h: int) -> tuple[tuple[int, int], ...]:
        return tuple((x, claim[1]) for x, claim in enumerate(s.claims) if claim and claim[0] == h)

    def _deployment(self, s: State, h: int) -> tuple[int, int, int] | None:
        found = s.deployments[self.names[h]]
        return found if found and found[0] == h else None

    def _forged(self, s: State, kind: str) -> Forged:
        return tuple((self.who[h], x, how) for what, h, x, how in s.forged if what == kind)

    def _named(self, s: State, h: int) -> int:
        found = self._deployment(s, h)
        return found[1] if found else NONE

    def _unseen(self, s: State, h: int, x: int) -> bool:
        """Ready, the node has ended what the API server does not list: kubelets do so well within the quarantine."""
        ready = h not in s.away and not any(one == h for one, _ in s.unlisted)
        return self.rules.unseen(x in s.noted, ready, x in s.confirmed)

    def _rightly_parked(self, s: State, h: int, x: int) -> bool:
        return s.claims[x] == (h, PARKED) and self._unseen(s, h, x)

    def _claim_changed(
        self, s: State, x: int, value: tuple[int, int] | None, *, forget_node: bool = False
    ) -> dict[str, Any]:
        """A write of the claim. What an admin has confirmed is over once the claim stands again."""
        changed: dict[str, Any] = {"claims": put(s.claims, x, value)}
        if forget_node and x in s.noted:
            changed["noted"] = swap(s.noted, x)
        over = value is None or (value[1] == RESERVED and self.rules.confirmation_ends())
        if over and x in s.confirmed:
            changed["confirmed"] = swap(s.confirmed, x)
        return changed

    def _ops(
        self, s: State, k: int = -1, to: tuple[Any, ...] = IDLE, *, claim: int = -1, name: int = -1
    ) -> tuple[tuple[Any, ...], ...]:
        after = list(s.operators)
        for j, op in enumerate(after):
            if j == k:
                after[j] = to
            elif op != IDLE and ((op[0] == "adopt" and op[2] == claim) or (self.fenced and self.names[op[1]] == name)):
                after[j] = IDLE
        after.sort()
        return tuple(after)

    def _sweeps(
        self, s: State, k: int = -1, to: tuple[Any, ...] = RESTING, *, claim: int = -1, gone: bool = False
    ) -> tuple[tuple[Any, ...], ...]:
        refused = self.precondition == "rv" or (self.precondition == "uid" and gone)

        after = list(s.sweepers)
        for j, sweeper in enumerate(after):
            if j == k:
                after[j] = to
            elif refused and sweeper[0] == claim:
                after[j] = RESTING
        after.sort()
        return tuple(after)

    def _set_deployment(self, s: State, h: int, value: tuple[int, int, int] | None, k: int = -1) -> dict[str, Any]:
        name = self.names[h]
        changed = s.deployments[name] != value
        return {
            "deployments": put(s.deployments, name, value),
            "operators": self._ops(s, k, name=name if changed else -1),
        }
