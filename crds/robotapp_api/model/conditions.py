"""metav1.Condition and the seven a RobotApp has from its creation."""

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model import names
from robotapp_api.model.base import Model
from robotapp_api.model.markers import ListMap
from robotapp_api.model.scalars import Generation, Timestamp

ConditionStatus = Literal["True", "False", "Unknown"]
NEVER = "1970-01-01T00:00:00Z"
WAITING = "Waiting for the operator"


class Condition(Model):
    """One aspect of the observed state."""

    type: Annotated[str, StringConstraints(max_length=316, pattern=r"^[A-Za-z][A-Za-z0-9./-]*$")]
    """Aspect the condition is about, such as Ready."""
    status: ConditionStatus
    """True, False or Unknown."""
    reason: Annotated[
        str, StringConstraints(min_length=1, max_length=1024, pattern=r"^[A-Za-z]([A-Za-z0-9_,:]*[A-Za-z0-9_])?$")
    ]
    """CamelCase word for programs that says why the condition has its status."""
    message: Annotated[str, StringConstraints(max_length=32768)]
    """Sentence for people, with the next step."""
    last_transition_time: Timestamp
    """When the status last changed."""
    observed_generation: Generation | None = None
    """Generation of the object the condition is about."""


def initial_conditions() -> tuple[Condition, ...]:
    """What the schema stores in a new RobotApp, before any operator has seen it."""
    return tuple(
        Condition(
            type=kind.value,
            status="Unknown",
            reason=names.Reason.PENDING.value,
            message=WAITING,
            last_transition_time=NEVER,
        )
        for kind in names.Condition
    )


def condition(
    kind: str,
    status: str,
    reason: str,
    message: str,
    *,
    before: Iterable[Mapping[str, Any]],
    generation: int,
    now: str,
) -> dict[str, Any]:
    """A condition as plain JSON. Its time stays that of `before` (all conditions so far) unless the status is another one.

    The times of `initial_conditions` are no times of ours: the first status the operator writes is dated `now`.
    """
    old = next((item for item in before if item.get("type") == kind), {})
    same = old.get("status") == status and old.get("observedGeneration") is not None
    return {
        "type": kind,
        "status": status,
        "reason": reason,
        "message": message,
        "lastTransitionTime": old["lastTransitionTime"] if same else now,
        "observedGeneration": generation,
    }


Conditions = Annotated[tuple[Condition, ...], ListMap("type"), Field(max_length=16)]
