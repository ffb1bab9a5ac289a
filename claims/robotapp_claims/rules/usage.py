"""Rule 3: which objects still use a domain id.

A Deployment, a Job that has not ended, a ReplicaSet that has or wants pods, and a pod that has not ended, pending ones included,
use the ids that their ROS_DOMAIN_ID names, for the app uid and instance of their labels in their own namespace, and for the claim their
annotation names (apps that share a domain). Any user may write labels, so a Deployment, Job or ReplicaSet counts only
if its owners prove it (`Owners`); a live pod of the holder's namespace counts without that, because it transmits
regardless of its owner. The literal decides and the annotation only adds: users can edit an annotation of a running pod, but not
its environment.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeVar

from msgspec.structs import replace

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.completion.endings import ANNOTATIONS_READ, JobState, read_job_state
from robotapp_claims.rules.identity import domain_literal
from robotapp_claims.rules.objects import (
    ROS_DOMAIN_ID,
    Claim,
    Container,
    Deployment,
    EnvVar,
    Holder,
    Job,
    Meta,
    Pod,
    PodSpec,
    ReplicaSet,
)

Owner = TypeVar("Owner", Deployment, Job, ReplicaSet)
InstanceKey = tuple[str, str, str]
"""(namespace, app uid, instance)."""
_SHOWN: Final = 32
"""Characters of a user's text that go into a message."""
HOPS: Final = 3
"""Pod, ReplicaSet, Deployment, or pod and Job: whatever is owned in more steps was not made for a RobotApp."""


# Whose object this is: labels find candidates, owner references prove.
#
# A user who may write a Deployment may write any label on it, also the uid of another tenant's app. What cannot be forged is
# an owner that exists: the chain of owners has to lead, inside one namespace, to a RobotApp of the labelled uid,
# and the caller reads from the API server whether that RobotApp exists.


class AppRef(NamedTuple):
    """A RobotApp as owner references name it; whether it exists is another question."""

    namespace: str
    name: str
    uid: str


class Owners:
    """The Deployments, Jobs and ReplicaSets of one listing, by uid."""

    def __init__(self, found: Iterable[Meta] = ()) -> None:
        self._known: dict[str, Meta] = {}
        for meta in found:
            self.add(meta)

    def __repr__(self) -> str:
        return f"<Owners: {len(self._known)} objects>"

    def add(self, meta: Meta) -> None:
        self._known[meta.uid] = meta

    def app_of(self, meta: Meta) -> AppRef | None:
        """The RobotApp whose uid the object's label names, if its owners lead there; None for what only its labels claim."""
        current = meta
        for _ in range(HOPS):
            owner = current.controller
            if owner is None:
                return None
            if owner.is_app:
                return AppRef(meta.namespace, owner.name, owner.uid) if owner.uid == meta.app_uid else None
            known = self._known.get(owner.uid)
            if known is None or known.namespace != meta.namespace:
                return None
            current = known
        return None


def named_ids(spec: PodSpec) -> frozenset[int]:
    """The literal domain ids in the environment of any container; anything that is no plain number names nothing."""
    ids = (domain_literal(variable.value) for variable in _domain_variables(spec))
    return frozenset(number for number in ids if number is not None)


def unclear_domains(spec: PodSpec) -> frozenset[str]:
    """Domains written so that it is unknown which one ROS joins: `0x8`, `010`, or taken from elsewhere by valueFrom."""
    variables = (variable for variable in _domain_variables(spec) if domain_literal(variable.value) is None)
    return frozenset(v.value[:_SHOWN] or "valueFrom" for v in variables if v.value or v.value_from is not None)


def _domain_variables(spec: PodSpec) -> Iterator[EnvVar]:
    for container in (*spec.containers, *spec.init_containers):
        yield from (variable for variable in container.env if variable.name == ROS_DOMAIN_ID)


def deployment_ids(deployment: Deployment | Job) -> frozenset[int]:
    return named_ids(deployment.spec.template.spec)


def key_of(meta: Meta) -> InstanceKey | None:
    return (meta.namespace, meta.app_uid, meta.instance) if meta.app_uid else None


def holder_key(holder: Holder) -> InstanceKey:
    return (holder.namespace, holder.uid, holder.instance)


def counts(replica_set: ReplicaSet) -> bool:
    """A ReplicaSet scaled down for good does not use its id, or no app could ever change domains."""
    return replica_set.spec.replicas > 0 or replica_set.status.replicas > 0


@dataclass(slots=True)
class Usage:
    """What the workloads of one snapshot use. Read it only against claims that were read before the snapshot."""

    live: dict[InstanceKey, set[int]] = field(default_factory=lambda: defaultdict(set))
    """Ids of pods that have not ended, by their labels."""
    owned: dict[InstanceKey, set[int]] = field(default_factory=lambda: defaultdict(set))
    """Ids of Deployments, Jobs and ReplicaSets whose owners lead to the app that their labels name."""
    deployments: dict[InstanceKey, set[int]] = field(default_factory=lambda: defaultdict(set))
    """Ids that such Deployments and Jobs name: rule 4 prefers them."""
    jobs: dict[InstanceKey, dict[str, JobState]] = field(default_factory=lambda: defaultdict(dict))
    """By component: Jobs whose owners lead to the app that their labels name, those that have ended as well. {} where all are being deleted."""
    named_by_pods: set[tuple[str, str]] = field(default_factory=set)
    """(namespace, claim) of live pods: apps of one namespace may share without asking."""
    checked: set[str] = field(default_factory=set)
    """Claims that pods name which our scheduler has bound: it saw then that their app may use them."""
    places: dict[InstanceKey, set[tuple[int, str]]] = field(default_factory=lambda: defaultdict(set))
    """(id, node) of pods that have not ended, by their labels; "" for the node of a pod that is not bound yet."""
    places_named: dict[str, set[tuple[str, str]]] = field(default_factory=lambda: defaultdict(set))
    """By claim: (namespace, node) of live pods that name it; "" for the namespace of those that our scheduler has bound."""
    named: dict[str, set[AppRef]] = field(default_factory=lambda: defaultdict(set))
    """By claim: the apps whose objects name it."""
    owners: Owners = field(default_factory=Owners)

    def __repr__(self) -> str:
        return (
            f"<Usage of {len(self.live)} running and {len(self.owned)} owned instances, {len(self.named)} claims named>"
        )

    def add_deployment(self, deployment: Deployment) -> None:
        self.owners.add(deployment.metadata)
        template = deployment.spec.template
        key = self._add(deployment.metadata, template.metadata, template.spec)
        if key is not None:
            self.deployments[key] |= deployment_ids(deployment)

    def add_job(self, job: Job) -> None:
        """Counts a Job. One that has ended starts no pod any more, so it uses no id; one that is being deleted decides nothing, as for
        the operator: it is about to be made anew.
        """
        self.owners.add(job.metadata)
        key = key_of(job.metadata)
        if key is None or self.owners.app_of(job.metadata) is None:
            return
        states = self.jobs[key]
        if job.metadata.deletion_timestamp is None:
            states[job.metadata.labels.get(Label.COMPONENT, "")] = read_job_state(job)
        if job.status.verdict is None:
            template = job.spec.template
            self._add(job.metadata, template.metadata, template.spec)
            self.deployments[key] |= deployment_ids(job)

    def add_replica_set(self, replica_set: ReplicaSet) -> None:
        """After the Deployments: they are its owners."""
        self.owners.add(replica_set.metadata)
        if counts(replica_set):
            template = replica_set.spec.template
            self._add(replica_set.metadata, template.metadata, template.spec)

    def add_pod(self, pod: Pod) -> None:
        """After its owners."""
        key = key_of(pod.metadata)
        if pod.terminal or key is None:
            return
        ids = named_ids(pod.spec)
        self.live[key] |= ids
        node = pod.spec.node_name
        self.places[key] |= {(number, node) for number in ids}
        claim = _named_claim(pod.metadata, ids)
        if not claim:
            return
        self.places_named[claim].add(("" if pod.spec.bound_by_us else pod.metadata.namespace, node))
        self.named_by_pods.add((pod.metadata.namespace, claim))
        if pod.spec.bound_by_us:
            self.checked.add(claim)
        app = self.owners.app_of(pod.metadata)
        if app is not None:
            self.named[claim].add(app)

    def _add(self, meta: Meta, template: Meta, spec: PodSpec) -> InstanceKey | None:
        """Count what proves its owner; its key, or None for what does not."""
        key, app = key_of(meta), self.owners.app_of(meta)
        if key is None or app is None:
            return None
        ids = named_ids(spec)
        self.owned[key] |= ids
        if claim := _named_claim(template, ids):
            self.named[claim].add(app)
        return key

    def uses(self, claim: Claim, *, app_exists: bool) -> bool:
        """Whether anything of the holder's own, or a live pod that shares, still names this domain claim.

        app_exists: whether the holder's app was read after the claim. Without it only live pods count: those of an app
        that was deleted alone (`--cascade=orphan`) go on, but an empty Deployment would pin the id for ever.
        """
        domain, key = claim.spec.domain, holder_key(claim.holder)
        if domain is None:
            return False
        return (
            domain.id in self.live.get(key, ())
            or (claim.holder.namespace, claim.name) in self.named_by_pods
            or claim.name in self.checked
            or (app_exists and domain.id in self.owned.get(key, ()))
        )

    def nodes(self, claim: Claim) -> frozenset[str]:
        """Where the live pods that use this domain claim are; "" stands for all those that are not bound yet."""
        domain, namespace = claim.spec.domain, claim.holder.namespace
        if domain is None:
            return frozenset()
        own = {node for number, node in self.places.get(holder_key(claim.holder), ()) if number == domain.id}
        named = self.places_named.get(claim.name, ())
        return frozenset(own | {node for where, node in named if where in {"", namespace}})

    def sharers(self, claim: Claim) -> frozenset[AppRef]:
        """Other apps whose objects name this claim. The caller checks whether they exist and may share it."""
        return frozenset(app for app in self.named.get(claim.name, ()) if app.uid != claim.holder.uid)

    def named_by_deployments(self, holder: Holder) -> frozenset[int]:
        return frozenset(self.deployments.get(holder_key(holder), ()))

    def named_by_instance(self, namespace: str, uid: str) -> dict[str, frozenset[int]]:
        """Per instance of one app that has Deployments or Jobs: the ids they name."""
        ended = {key[2]: frozenset[int]() for key in self.jobs if key[:2] == (namespace, uid)}
        return ended | {key[2]: frozenset(ids) for key, ids in self.deployments.items() if key[:2] == (namespace, uid)}


def _named_claim(meta: Meta, ids: Collection[int]) -> str:
    """The claim an annotation names, as far as the environment backs it."""
    claim = meta.annotations.get(Annotation.DOMAIN_CLAIM, "")
    return claim if any(claim.endswith(f".{number}") for number in ids) else ""


# What a sweep keeps of its lists: of 3000 pods with their owners they would be 100 MB, most of it environment and labels.


def owner_as_used(owner: Owner) -> Owner:
    """A Deployment, Job or ReplicaSet with all that `Usage` reads of it."""
    template = owner.spec.template
    meta = _with(template.metadata, annotations=(Annotation.DOMAIN_CLAIM,))
    kept = replace(template, metadata=meta, spec=_domains_only(template.spec))
    return replace(
        owner,
        metadata=_with(
            owner.metadata,
            labels=(Label.APP_UID, Label.INSTANCE, Label.COMPONENT),
            annotations=ANNOTATIONS_READ,
        ),
        spec=replace(owner.spec, template=kept),
    )


def pod_as_used(pod: Pod) -> Pod:
    """A pod without those variables of its environment that name no domain."""
    return replace(pod, spec=_domains_only(pod.spec))


def _with(meta: Meta, *, labels: Iterable[Label] = (), annotations: Iterable[Annotation] = ()) -> Meta:
    return replace(
        meta,
        labels={str(key): meta.labels[key] for key in labels if key in meta.labels},
        annotations={str(key): meta.annotations[key] for key in annotations if key in meta.annotations},
    )


def _domains_only(spec: PodSpec) -> PodSpec:
    return replace(
        spec,
        containers=tuple(map(_domain_variable_only, spec.containers)),
        init_containers=tuple(map(_domain_variable_only, spec.init_containers)),
    )


def _domain_variable_only(container: Container) -> Container:
    return Container(env=tuple(variable for variable in container.env if variable.name == ROS_DOMAIN_ID))


def usage_of(
    *,
    deployments: Iterable[Deployment] = (),
    replica_sets: Iterable[ReplicaSet] = (),
    jobs: Iterable[Job] = (),
    pods: Iterable[Pod] = (),
) -> Usage:
    usage = Usage()
    for deployment in deployments:
        usage.add_deployment(deployment)
    for replica_set in replica_sets:
        usage.add_replica_set(replica_set)
    for job in jobs:
        usage.add_job(job)
    for pod in pods:
        usage.add_pod(pod)
    return usage
