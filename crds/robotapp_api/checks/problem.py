"""What a check finds: a problem with its reason code, or a note; each with the field and a sentence with the cure."""

from typing import NamedTuple

from robotapp_api.model.names import Reason


class Problem(NamedTuple):
    """`field` is written as in YAML, such as `spec.components[0].env`; "" for the object as a whole.

    `of_cluster`: the spec does not fit the nodes or the pool there are, so a change of these heals it as well as one of the spec.
    """

    reason: Reason
    field: str
    message: str
    of_cluster: bool = False

    def __str__(self) -> str:
        return f"{self.field}: {self.message}" if self.field else self.message


class Note(NamedTuple):
    """A field that is accepted, and does less or something else than its author may expect. No condition has a reason for it."""

    field: str
    message: str

    def __str__(self) -> str:
        return f"{self.field}: {self.message}"


def invalid(field: str, message: str) -> Problem:
    return Problem(Reason.INVALID_SPEC, field, message)
