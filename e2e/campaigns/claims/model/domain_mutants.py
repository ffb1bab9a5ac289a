"""Weakened domain rules. Each must be caught, or a product rule could be weakened without a test noticing."""

from typing import Any

from tests.support.claims import objects as make

from campaigns.claims.model.domain_rules import ELSEWHERE, DomainRules, Instance, JobRules
from robotapp_claims.rules import bind, usage
from robotapp_claims.rules.domain import DomainPlan, Step
from robotapp_claims.rules.objects import Claim, Pod, ReplicaSet
from robotapp_claims.rules.release import Release


class NoBindCheck(DomainRules):
    """The template is the lock."""

    def bind(self, pod: Pod, claim: Claim | None, app_state: str) -> bool:  # noqa: ARG002 - binds whatever it is
        return True


class Forced(DomainRules):
    """Template writes without the version of the Deployment that was read."""

    def fenced(self) -> bool:
        return False


class ForcedNoBindCheck(NoBindCheck, Forced):
    pass


class HistoryCounts(DomainRules):
    """L1: a ReplicaSet scaled down for good still uses its id."""

    def usage_of_sets(self, objects: list[ReplicaSet]) -> Any:
        found = usage.usage_of()
        for one in objects:
            found._add(one.metadata, one.spec.template.metadata, one.spec.template.spec)
        return found


class AnyChildKeepsAll(DomainRules):
    """L2: any object of an instance keeps all its claims."""

    def uses_deployments(self, who: Instance, number: int, found: Any, *rest: Any) -> bool:
        return super().uses_deployments(who, number, tuple((owner, number) for owner, _ in found), *rest)

    def uses_sets(self, who: Instance, number: int, found: Any, *rest: Any) -> bool:
        return super().uses_sets(who, number, tuple((owner, number, up) for owner, _, up in found), *rest)

    def uses_pods(self, who: Instance, number: int, found: Any, *rest: Any) -> bool:
        return super().uses_pods(who, number, tuple((owner, number) for owner, _ in found), *rest)


class OwnerChain(DomainRules):
    """L3: the bind check wants the chain of owners up to a live RobotApp."""

    def bind(self, pod: Pod, claim: Claim | None, app_state: str) -> bool:
        return app_state != "O" and super().bind(pod, claim, app_state)


class UnheldStays(DomainRules):
    """L4: a template that names an id its instance does not hold stays as it is."""

    def scales_down(self, who: Instance, named: int, held: tuple[int, ...]) -> bool:  # noqa: ARG002 - never
        return False


class NoList(DomainRules):
    """M1: create without looking for claims the instance has."""

    def plans(
        self, who: Instance, held: tuple[tuple[int, int], ...], named: int, want: int, ids: tuple[int, ...]
    ) -> tuple[DomainPlan, ...]:
        (plan,) = super().plans(who, held[:0], min(named, -1), want, ids)
        return (DomainPlan(Step.CREATE, candidates=plan.candidates),)


class RandomOrder(DomainRules):
    """M2: operators try ids in an order of their own."""

    def plans(
        self, who: Instance, held: tuple[tuple[int, int], ...], named: int, want: int, ids: tuple[int, ...]
    ) -> tuple[DomainPlan, ...]:
        (plan,) = super().plans(who, held, named, want, ids)
        return (plan, DomainPlan(plan.step, plan.id, plan.candidates[::-1]))


class PodsOnly(DomainRules):
    """M3: only pods use an id."""

    def uses_deployments(self, *_: Any) -> bool:  # never
        return False

    def uses_sets(self, *_: Any) -> bool:
        return False


class JobsNotListed(JobRules):
    """M3j: only pods of jobs use an id."""

    def __init__(self) -> None:
        super().__init__(counted=False)


class EndedJobsCount(JobRules):
    """L1j: a job that has ended still uses its id."""

    def __init__(self) -> None:
        super().__init__(ended_ones_too=True)


class NoSecondLook(DomainRules):
    """M4: after the quarantine the claim is deleted without reading anything again."""

    def keeps(self, phase: int, wanted: bool, used: bool, unseen: bool = False) -> Release:
        return Release.DELETE if phase else super().keeps(phase, wanted, used, unseen)


class OnePhase(DomainRules):
    """M5: unused is deleted at once."""

    def keeps(self, phase: int, wanted: bool, used: bool, unseen: bool = False) -> Release:
        decision = super().keeps(phase, wanted, used, unseen)
        return Release.DELETE if decision is Release.DRAIN else decision


class ForbiddenIsGone(DomainRules):
    """M6: a 403 is taken for a 404."""

    def error_means_gone(self) -> bool:
        return True


class UidOnly(DomainRules):
    """M7: deletes carry the uid but not the version."""

    def precondition(self) -> str:
        return "uid"


class ByName(DomainRules):
    """M8: deletes carry nothing."""

    def precondition(self) -> str:
        return "none"


class BindOnDraining(DomainRules):
    """M10: the bind check accepts a claim that is being released."""

    def bind(self, pod: Pod, claim: Claim | None, app_state: str) -> bool:  # noqa: ARG002 - the base class looks
        if claim is not None and claim.spec.domain is not None:
            claim = make.domain_claim(claim.spec.domain.id, claim.holder)
        return bind.bind_verdict(pod, claim).allowed


class NeverParked(DomainRules):
    """P1: what the API server does not list does not run."""

    def unseen(self, *_: Any) -> bool:
        return False


class NodeNotNoted(DomainRules):
    """P2: the claim does not name the node before the pod is bound."""

    def notes_node(self, known: bool) -> bool:  # noqa: ARG002 - never
        return False


class NodeNotedOnce(DomainRules):
    """P3: a claim that names the node already is not written again, so whoever has read it before is not refused."""

    def notes_node(self, known: bool) -> bool:
        return not known


class BindOnParked(DomainRules):
    """P4: the bind check accepts a claim that is parked."""

    def bind(self, pod: Pod, claim: Claim | None, app_state: str) -> bool:  # noqa: ARG002 - the base class looks
        if claim is not None and claim.spec.domain is not None and claim.parked:
            claim = make.domain_claim(claim.spec.domain.id, claim.holder)
        return bind.bind_verdict(pod, claim).allowed


class ConfirmedForEver(DomainRules):
    """P5: what an admin said of a parked claim still holds when it is parked again."""

    def confirmation_ends(self) -> bool:
        return False


class NoRepairs(DomainRules):
    """Nothing is made for who runs, so that a search looks for pins alone."""

    def repairs(self, *_: Any) -> bool:
        return False


class LabelsProve(NoRepairs):
    """A1: whose labels an object wears, to whom it belongs, wherever it is and whoever owns it."""

    def exists(self, app_state: str) -> bool:  # noqa: ARG002 - nobody asks
        return True

    def forge(self, obj: Any, how: str) -> Any:  # noqa: ARG002 - nobody looks
        return obj


class OwnersUnchecked(NoRepairs):
    """A2: owner references are believed without asking whether the app exists."""

    def exists(self, app_state: str) -> bool:  # noqa: ARG002 - nobody asks
        return True

    def forge(self, obj: Any, how: str) -> Any:
        return obj if how == ELSEWHERE else super().forge(obj, how)


class RepairsByLabel(DomainRules):
    """A3: a claim is made for whatever pod says that it stands on it."""

    def repairs(self, *_: Any) -> bool:
        return True


class LostClaimsForgotten(DomainRules):
    """E1: after a restore of etcd the ids that were granted since the snapshot are free."""

    def makes_lost_claims(self) -> bool:
        return False


class LostNodesForgotten(DomainRules):
    """E2: a claim that the snapshot has does not name the nodes where its pods were bound since."""

    def notes_lost_nodes(self) -> bool:
        return False


class GoesOn(DomainRules):
    """E3: what was decided before a restore is carried out after it."""

    def starts_again(self) -> bool:
        return False
