"""Children of an app: what all of them have in common."""

import dataclasses
from typing import Any, Final

from robotapp_api.model.names import API_VERSION, OPERATOR_MANAGER, Annotation, Label
from robotapp_operator.plan.spec.covers import content_hash
from robotapp_operator.plan.spec.desired import App, Desired
from robotapp_operator.plan.spec.objects import ChildRef

DEPLOYMENT: Final = "Deployment"
JOB: Final = "Job"
SERVICE: Final = "Service"
_API_VERSIONS: Final = {DEPLOYMENT: "apps/v1", JOB: "batch/v1", SERVICE: "v1"}


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Child:
    """A wanted object, not to be changed.

    `hash` covers labels, spec and a Service's annotations; it is written as an annotation and compared before any write.
    change: which ConfigMaps or Secrets have changed, so that its pods start anew; "" for none.
    """

    ref: ChildRef
    labels: dict[str, str]
    spec: dict[str, Any]
    annotations: dict[str, str] = dataclasses.field(default_factory=dict)
    change: str = ""
    hash: str = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        content: list[Any] = [self.labels, self.spec]
        if self.ref.kind == SERVICE and self.annotations:  # those of a Deployment record its past
            content.append(self.annotations)
        object.__setattr__(self, "hash", content_hash(content))

    @property
    def component(self) -> str:
        """The component's name, empty for the instance's infrastructure."""
        return self.labels.get(Label.COMPONENT, "")

    def body(self, app: App, *, version: str) -> dict[str, Any]:
        """The object to write: complete, with owner, hash and the operator version that rendered it."""
        ours = {
            Annotation.RENDERED_BY.value: version,
            Annotation.APP_GENERATION.value: str(app.generation),
            Annotation.SPEC_HASH.value: app.spec_hashes[self.component],
            Annotation.CONTENT_HASH.value: self.hash,
        }
        if overrides := app.overrides.get(self.component):
            ours[Annotation.OVERRIDES.value] = ",".join(overrides)
        return {
            "apiVersion": _API_VERSIONS[self.ref.kind],
            "kind": self.ref.kind,
            "metadata": {
                "name": self.ref.name,
                "namespace": app.namespace,
                "labels": self.labels,
                "annotations": self.annotations | ours,
                "ownerReferences": [owner_reference(app)],
            },
            "spec": self.spec,
        }


def owner_reference(app: App) -> dict[str, Any]:
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "name": app.name,
        "uid": app.uid,
        "controller": True,
        "blockOwnerDeletion": True,
    }


def instance_labels(desired: Desired) -> dict[str, str]:
    """Labels every child of an instance carries; they find candidates, the owner chain decides membership."""
    return {
        Label.APP.value: desired.app.name,
        Label.APP_UID.value: desired.app.uid,
        Label.INSTANCE.value: desired.robot,
        Label.PART_OF.value: desired.app.name,
        Label.MANAGED_BY.value: OPERATOR_MANAGER,
    }


def component_labels(desired: Desired, component: str) -> dict[str, str]:
    own = {Label.COMPONENT.value: component, Label.NAME.value: component}
    if replica := desired.app.replicas.get(component):
        own |= replicas_labels(desired, replica.component) | {Label.NAME.value: replica.component}
    return instance_labels(desired) | own


def replicas_labels(desired: Desired, component: str) -> dict[str, str]:
    """Returns the labels that all replicas of a component have, whose ordinals make each a component of its own."""
    return instance_labels(desired) | {Label.REPLICA_OF.value: component}


def role_labels(desired: Desired, role: str) -> dict[str, str]:
    """Infrastructure pods have a role instead of a component: they are no members of the scheduling group."""
    return instance_labels(desired) | {Label.ROLE.value: role, Label.NAME.value: role}


def selector(labels: dict[str, str]) -> dict[str, str]:
    """The immutable part: without the uid, so that an app re-created under its name keeps working."""
    kept = (Label.APP, Label.INSTANCE, Label.COMPONENT, Label.REPLICA_OF, Label.ROLE, Label.PART)
    return {label.value: labels[label.value] for label in kept if label.value in labels}
