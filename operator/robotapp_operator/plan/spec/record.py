"""A RobotApp as read from the API server: its parsed spec, or why it could not be read, and its status."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

from pydantic import ValidationError

from robotapp_api.checks.size import size_problem
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.names import QUEUE_NAME, SCHEDULER_NAME, Annotation, Reason
from robotapp_api.values.recordings.components import add_recorders
from robotapp_operator.plan.spec.desired import NO_ABILITIES, NO_SETTINGS, Abilities, App, HelperDefaults
from robotapp_operator.plan.spec.objects import version_number
from robotapp_operator.plan.spec.unknown_fields import find_unknown_fields
from robotapp_operator.plan.spec.validate import Problem

_READ: Final = frozenset(annotation.value for annotation in Annotation)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """`app` is None when the spec cannot be parsed; `problems` then has the reasons.

    `suspended` is read from the object itself: a user's stop must not depend on what else this version understands.
    """

    name: str
    namespace: str
    uid: str
    generation: int
    resource_version: str
    deleting: bool
    app: App | None
    suspended: bool = False
    problems: tuple[Problem, ...] = ()
    status: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def version_number(self) -> int:
        return version_number(self.resource_version)

    @property
    def spec_version(self) -> tuple[object, ...]:
        """Changes when anything but the status does."""
        return self.generation, self.deleting, (self.app.annotations, self.app.queue) if self.app else None


def parse_record(
    body: Mapping[str, Any],
    *,
    known: Record | None = None,
    default_scheduler: str = SCHEDULER_NAME,
    helper_defaults: HelperDefaults = NO_SETTINGS,
    abilities: Abilities = NO_ABILITIES,
) -> Record:
    """`known` of the same generation lends its parsed spec: a status write must not cost a validation."""
    meta = body.get("metadata") or {}
    annotations = {key: value for key, value in (meta.get("annotations") or {}).items() if key in _READ}
    queue = (meta.get("labels") or {}).get(QUEUE_NAME, "")
    app: App | None = None
    problems: tuple[Problem, ...] = ()
    if known and known.uid == meta.get("uid") and known.generation == meta.get("generation"):
        app = dataclasses.replace(known.app, annotations=annotations, queue=queue) if known.app else None
        problems = known.problems
    elif isinstance(spec := _parse_spec(body.get("spec") or {}), RobotAppSpec):
        app = App(
            name=meta.get("name", ""),
            namespace=meta.get("namespace", ""),
            uid=meta.get("uid", ""),
            generation=meta.get("generation", 0),
            spec=add_recorders(spec, image=helper_defaults.recorder_image, user=helper_defaults.user),
            annotations=annotations,
            created=meta.get("creationTimestamp") or "",
            default_scheduler=default_scheduler,
            helper_defaults=helper_defaults,
            unknown_fields=find_unknown_fields(spec, body["spec"]),
            abilities=abilities,
            queue=queue,
        )
    else:
        problems = spec
    return Record(
        name=meta.get("name", ""),
        namespace=meta.get("namespace", ""),
        uid=meta.get("uid", ""),
        generation=meta.get("generation", 0),
        resource_version=meta.get("resourceVersion", ""),
        deleting=bool(meta.get("deletionTimestamp")),
        app=app,
        suspended=(body.get("spec") or {}).get("suspend") is True,
        problems=problems,
        status=body.get("status") or {},
    )


def _parse_spec(body: Mapping[str, Any]) -> RobotAppSpec | tuple[Problem, ...]:
    """The spec, or why there is none. One that is too large is not kept in memory."""
    if too_large := size_problem(body):
        return (too_large,)
    try:
        return RobotAppSpec.model_validate(body)
    except ValidationError as error:
        return tuple(_problem(item) for item in error.errors()[:8])


def _problem(error: Mapping[str, Any]) -> Problem:
    path = ".".join(str(part) for part in error["loc"])
    return Problem(
        Reason.INVALID_SPEC, f"spec.{path}", f"{error['msg']}; kubectl explain robotapp.spec shows what is allowed"
    )
