"""Rule 3: which objects still use a domain id.

A Deployment, a ReplicaSet that has or wants pods, and a pod that has not ended, pending ones included, use the ids that
their ROS_DOMAIN_ID names. They count for the app uid and instance of their labels, and for the claim their annotation
names (apps that share a domain). The literal decides and the annotation only adds: users can edit an annotation of a
running pod, but not its environment.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from robotapp_api.claims.identity import domain_literal
from robotapp_api.claims.objects import ROS_DOMAIN_ID, Claim, Deployment, EnvVar, Holder, Meta, Pod, PodSpec, ReplicaSet
from robotapp_api.model.names import Annotation

InstanceKey = tuple[str, str]
"""(app uid, instance)."""
_SHOWN: Final = 32
"""Characters of a user's text that go into a message."""


def named_ids(spec: PodSpec) -> frozenset[int]:
    """The literal domain ids in the environment of any container; anything that is no plain number names nothing."""
    ids = (domain_literal(variable.value) for variable in _domain_variables(spec))
    return frozenset(number for number in ids if number is not None)


def unclear_domains(spec: PodSpec) -> frozenset[str]:
    """Domains written so that we cannot tell which one ROS joins: `0x8`, `010`, or taken from elsewhere by valueFrom."""
    variables = (variable for variable in _domain_variables(spec) if domain_literal(variable.value) is None)
    return frozenset(v.value[:_SHOWN] or "valueFrom" for v in variables if v.value or v.value_from is not None)


def _domain_variables(spec: PodSpec) -> Iterator[EnvVar]:
    for container in (*spec.containers, *spec.init_containers):
        yield from (variable for variable in container.env if variable.name == ROS_DOMAIN_ID)


def deployment_ids(deployment: Deployment) -> frozenset[int]:
    return named_ids(deployment.spec.template.spec)


def key_of(meta: Meta) -> InstanceKey | None:
    """Labels decide whose object this is, not the chain of owners: orphans would wait for ever."""
    return (meta.app_uid, meta.instance) if meta.app_uid else None


def holder_key(holder: Holder) -> InstanceKey:
    return (holder.uid, holder.instance)


def counts(replica_set: ReplicaSet) -> bool:
    """A ReplicaSet scaled down for good does not use its id, or no app could ever change domains."""
    return replica_set.spec.replicas > 0 or replica_set.status.replicas > 0


@dataclass(slots=True)
class Usage:
    """What the workloads of one snapshot use. Read it only against claims that were read before the snapshot."""

    ids: dict[InstanceKey, set[int]] = field(default_factory=lambda: defaultdict(set))
    claims: set[str] = field(default_factory=set)
    """Claim names in annotations of RobotApp children."""
    deployments: dict[InstanceKey, set[int]] = field(default_factory=lambda: defaultdict(set))
    """Ids that Deployments name: rule 4 prefers them."""

    def __repr__(self) -> str:
        return f"<Usage of {len(self.ids)} instances, {len(self.claims)} claims named>"

    def add_deployment(self, deployment: Deployment) -> None:
        template = deployment.spec.template
        self._add(deployment.metadata, template.metadata, template.spec)
        if key := key_of(deployment.metadata):
            self.deployments[key] |= deployment_ids(deployment)

    def add_replica_set(self, replica_set: ReplicaSet) -> None:
        if counts(replica_set):
            template = replica_set.spec.template
            self._add(replica_set.metadata, template.metadata, template.spec)

    def add_pod(self, pod: Pod) -> None:
        if not pod.terminal:
            self._add(pod.metadata, pod.metadata, pod.spec)

    def _add(self, meta: Meta, template: Meta, spec: PodSpec) -> None:
        key = key_of(meta)
        if key is None:
            return
        ids = named_ids(spec)
        if ids:
            self.ids[key] |= ids
        claim = template.annotations.get(Annotation.DOMAIN_CLAIM, "")
        if any(claim.endswith(f".{number}") for number in ids):
            self.claims.add(claim)

    def uses(self, claim: Claim) -> bool:
        """Whether anything of the holder's instance, or of an app that shares, still names this domain claim."""
        domain = claim.spec.domain
        return domain is not None and (
            claim.name in self.claims or domain.id in self.ids.get(holder_key(claim.holder), ())
        )

    def named_by_deployments(self, holder: Holder) -> frozenset[int]:
        return frozenset(self.deployments.get(holder_key(holder), ()))

    def named_by_instance(self, uid: str) -> dict[str, frozenset[int]]:
        """Per instance of one app that has Deployments: the ids they name."""
        return {key[1]: frozenset(ids) for key, ids in self.deployments.items() if key[0] == uid}


def usage_of(
    *, deployments: Iterable[Deployment] = (), replica_sets: Iterable[ReplicaSet] = (), pods: Iterable[Pod] = ()
) -> Usage:
    usage = Usage()
    for deployment in deployments:
        usage.add_deployment(deployment)
    for replica_set in replica_sets:
        usage.add_replica_set(replica_set)
    for pod in pods:
        usage.add_pod(pod)
    return usage
