"""The product's decisions on domains, asked with model states: each method builds the objects and calls the function.

A mutant overrides one method (or swaps one product function) and must be caught by the exploration. Answers depend on a
few small values only, so every one is computed once.
"""

from functools import cache
from typing import Any

from msgspec import structs
from tests.support.claims import objects as make

from robotapp_claims.rules import bind, domain, release, usage
from robotapp_claims.rules.domain import DomainPlan, DomainRequest
from robotapp_claims.rules.identity import Found, domain_spec, id_order, same_tuple
from robotapp_claims.rules.objects import App, AppSpec, Claim, Deployment, Holder, Job, Meta, Pod, ReplicaSet, Ros2
from robotapp_claims.rules.release import Release
from robotapp_claims.rules.repair import lost_grant
from robotapp_client.transport.errors import ApiError, Forbidden, means_gone

AUTO = 99
"""An app that takes any id."""
NONE = -1
"""No id: an app that wants no domain, a Deployment that names none."""
RESERVED, DRAINING, PARKED = range(3)
PHASES = ("Reserved", "Draining", "Parked")
"""Phases of a claim, which a state holds by number."""
Instance = tuple[int, int]
"""(number of the RobotApp, number of the instance)."""
ELSEWHERE, ALONE = "elsewhere", "alone"
Forged = tuple[tuple[Instance, int, str], ...]
"""(instance it imitates, id, how)."""


@cache
def uid_of(app: int) -> str:
    """A uid whose order of ids is 0, 1, 2: all instances trying the ids in the same order is the worst case."""
    tries = (f"uid-{app}-{salt}" for salt in range(10_000))
    return next(uid for uid in tries if all(id_order((0, 1), uid, f"i{n}") == (0, 1) for n in range(4)))


class DomainRules:
    """Product rules. `memo` wraps each method once per object, so that mutants do not share answers."""

    def __init__(self) -> None:
        for name in (
            "plans",
            "keeps",
            "uses_deployments",
            "uses_sets",
            "uses_pods",
            "wants",
            "may_bind",
            "met",
            "repairs",
            "unseen",
            "confirmation_ends",
            "makes_lost_claims",
            "notes_lost_nodes",
        ):
            setattr(self, name, cache(getattr(self, name)))

    def holder(self, who: Instance) -> Holder:
        app, number = who
        return make.app_holder(uid_of(app), instance=f"i{number}", name=f"app-{app}")

    def labels(self, who: Instance) -> dict[str, str]:
        return make.labels(uid_of(who[0]), f"i{who[1]}", app=f"app-{who[0]}")

    def claim(self, who: Instance, number: int, phase: int) -> Claim:
        return make.domain_claim(number, self.holder(who), phase=PHASES[phase])

    def deployment(self, who: Instance, number: int, *, on: int) -> Deployment:
        numbers = () if number == NONE else (number,)
        return make.deployment(*numbers, of=self.labels(who), replicas=on)

    # Rules 4 and 5

    def plans(
        self, who: Instance, held: tuple[tuple[int, int], ...], named: int, want: int, ids: tuple[int, ...]
    ) -> tuple[DomainPlan, ...]:
        """held: (id, phase) of the instance. More than one answer only in mutants that toss a coin."""
        holder = self.holder(who)
        request = DomainRequest(holder=holder, requested_id=None if want == AUTO else want)
        plan = domain.plan_domain(
            held={number: not self.claim(who, number, phase).standing for number, phase in held},
            named=[frozenset(() if named == NONE else (named,))],
            free=frozenset(ids) if want == AUTO else (),
            uid=holder.uid,
            instance=holder.instance,
            requested=request.requested_id,
        )
        return (plan,)

    def met(self, who: Instance, number: int, holder: Instance) -> Found:
        wanted = domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=number, holder=self.holder(who))
        return same_tuple(wanted, self.claim(holder, number, 0).spec)

    def scales_down(self, who: Instance, named: int, held: tuple[int, ...]) -> bool:
        """Whether a Deployment naming this id is stopped while no id can be had."""
        return bool(domain.naming_unheld([self.deployment(who, named, on=1)], held))

    def fenced(self) -> bool:
        """Whether the template write carries the Deployment's version."""
        fences = domain.fences_of([self.deployment((0, 0), 0, on=1)])
        return all(fence.resource_version and fence.uid for fence in fences.values())

    # Rule 1

    def may_bind(self, who: Instance, number: int, holder: Instance | None, phase: int, app_state: str) -> bool:
        pod = make.pod(number, of=self.labels(who))
        claim = None if holder is None else self.claim(holder, number, phase)
        return self.bind(pod, claim, app_state)

    def bind(self, pod: Pod, claim: Claim | None, app_state: str) -> bool:  # noqa: ARG002 - mutants look at the app
        return bind.bind_verdict(pod, claim).allowed

    def notes_node(self, known: bool) -> bool:  # noqa: ARG002 - a mutant looks whether the claim names the node already
        """Whether the bind check writes the pod's node into the claim."""
        return True

    # Rules 2 and 3

    def uses_deployments(
        self, who: Instance, number: int, found: tuple[tuple[Instance, int], ...], app_state: str, forged: Forged
    ) -> bool:
        objects = [self.deployment(owner, named, on=1) for owner, named in found]
        objects += [self.forge(self.deployment(owner, named, on=0), how) for owner, named, how in forged]
        return usage.usage_of(deployments=objects).uses(self.claim(who, number, 0), app_exists=self.exists(app_state))

    def uses_sets(
        self, who: Instance, number: int, found: tuple[tuple[Instance, int, int], ...], app_state: str, forged: Forged
    ) -> bool:
        """found: (owner, id, wanted pods)."""
        objects = [make.replica_set(n, wanted=up, present=up, of=self.labels(owner)) for owner, n, up in found]
        objects += [self.forge(make.replica_set(n, of=self.labels(owner)), how) for owner, n, how in forged]
        return bool(self.usage_of_sets(objects).uses(self.claim(who, number, 0), app_exists=self.exists(app_state)))

    def usage_of_sets(self, objects: list[ReplicaSet]) -> Any:
        return usage.usage_of(replica_sets=objects)

    def uses_pods(
        self, who: Instance, number: int, found: tuple[tuple[Instance, int], ...], forged: Forged = ()
    ) -> bool:
        objects = [make.pod(n, of=self.labels(owner), phase="Running") for owner, n in found]
        objects += [self.forged_pod(owner, n, how) for owner, n, how in forged]
        return usage.usage_of(pods=objects).uses(self.claim(who, number, 0), app_exists=False)

    def exists(self, app_state: str) -> bool:
        return app_state == "L"

    # The attacker: labels and owners as anybody may write them

    def forge(self, obj: Any, how: str) -> Any:
        """The true object's look-alike: `elsewhere` in another namespace, `alone` without owners."""
        changed = {"owner_references": ()} if how == ALONE else {"namespace": "attacker"}
        return structs.replace(obj, metadata=structs.replace(obj.metadata, **changed))

    def forged_pod(self, who: Instance, number: int, how: str) -> Pod:
        """Bound by a scheduler that checks nothing, with the annotation of whom it imitates."""
        notes = {"robotics.io/domain-claim": f"dds.default.c.{number}"}
        pod = make.pod(number, of=self.labels(who), node="edge-1", phase="Running", annotations=notes)
        found: Pod = self.forge(pod, how)
        return found

    def repairs(self, who: Instance, number: int, how: str, app_state: str) -> bool:
        """Whether a sweep makes a claim because of a forged pod that runs."""
        pod = self.forged_pod(who, number, how)
        app = usage.usage_of(pods=[pod]).owners.app_of(pod.metadata)
        return app is not None and app.namespace == self.holder(who).namespace and self.exists(app_state)

    def wants(self, who: Instance, number: int, held: tuple[int, ...], named: int, want: int | None) -> bool:
        """want: what the app's spec says; None when the app is gone."""
        holder = self.holder(who)
        spec = AppSpec(ros2=Ros2(domain=None if want == AUTO else want))
        app = (
            None if want is None else App(metadata=Meta(name=holder.name, namespace="team", uid=holder.uid), spec=spec)
        )
        if app is None or release.is_gone(app, holder.uid) or want == NONE:
            return False
        siblings = [self.claim(who, other, 0) for other in held]
        return release.wants_domain(app, self.claim(who, number, 0), siblings, named=() if named == NONE else (named,))

    def keeps(self, phase: int, wanted: bool, used: bool, unseen: bool = False) -> Release:
        """The step of the sweep, the rest of a Draining claim being over."""
        claim = self.claim((0, 0), 0, phase)
        return release.release_domain(phase=claim.status.phase, wanted=wanted, used=used, rested=True, unseen=unseen)

    def unseen(self, noted: bool, node_ready: bool, confirmed: bool) -> bool:
        """Whether a node that the claim names has not been seen to end the pods there."""
        claim = make.domain_claim(0, nodes=("robot",) if noted else (), confirmed=confirmed)
        return bool(release.unseen_nodes(claim, ready={"robot"} if node_ready else ()))

    def confirmation_ends(self) -> bool:
        """Whether what an admin said of a parked claim holds no longer when it was adopted since."""
        claim = make.domain_claim(0, nodes=("robot",), confirmed=True)
        adopted = structs.replace(claim, status=structs.replace(claim.status, attempt=claim.status.attempt + 1))
        return bool(release.unseen_nodes(adopted, ready=()))

    # After a restore of etcd

    def makes_lost_claims(self) -> bool:
        """Whether claims that the snapshot lacks are made again from memory."""
        return lost_grant(make.domain_claim(0), None).create

    def notes_lost_nodes(self) -> bool:
        """Whether a claim that the snapshot has gets the nodes it has lost."""
        return bool(lost_grant(make.domain_claim(0, nodes=("robot",)), make.domain_claim(0)).nodes)

    def starts_again(self) -> bool:
        """Whether what was decided before the restore is dropped."""
        return True

    def precondition(self) -> str:
        """What a delete carries: rv, uid or none."""
        found = release.preconditions(self.claim((0, 0), 0, 0))
        return "rv" if found.resource_version else "uid" if found.uid else "none"

    def error_means_gone(self) -> bool:
        return means_gone(refusal(), "app-0")


class JobRules(DomainRules):
    """Workloads that end. A Job takes the place of the Deployment, and that of its ReplicaSet: one that is replaced is there until its last
    pod has ended, and one that has ended stays.
    """

    def __init__(self, *, counted: bool = True, ended_ones_too: bool = False) -> None:
        super().__init__()
        self._counted = counted
        self._ended_ones_too = ended_ones_too

    def uses_deployments(
        self, instance: Instance, number: int, found: tuple[tuple[Instance, int], ...], app_state: str, forged: Forged
    ) -> bool:
        jobs = [self.job(owner, named) for owner, named in found]
        jobs += [self.forge(self.job(owner, named), how) for owner, named, how in forged]
        return self._use(jobs, instance, number, app_state)

    def uses_sets(
        self,
        instance: Instance,
        number: int,
        found: tuple[tuple[Instance, int, int], ...],
        app_state: str,
        forged: Forged,
    ) -> bool:
        jobs = [self.job(owner, n, has_ended=not (up or self._ended_ones_too)) for owner, n, up in found]
        jobs += [self.forge(self.job(owner, n), how) for owner, n, how in forged]
        return self._use(jobs, instance, number, app_state)

    def job(self, instance: Instance, number: int, *, has_ended: bool = False) -> Job:
        numbers = () if number == NONE else (number,)
        return make.job(*numbers, of=self.labels(instance), verdict="Complete" if has_ended else "")

    def _use(self, jobs: list[Job], instance: Instance, number: int, app_state: str) -> bool:
        seen = usage.usage_of(jobs=jobs if self._counted else ())
        return seen.uses(self.claim(instance, number, 0), app_exists=self.exists(app_state))


def refusal() -> ApiError:
    return Forbidden('robotapps "app-0" is forbidden', status=403, reason="Forbidden")
