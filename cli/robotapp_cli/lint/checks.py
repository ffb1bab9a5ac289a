"""The list of checks, and those that are not about the schema. A new rule about a file is one more function in `CHECKS`.

A check takes a subject and yields findings by path. It runs after those before it and may look at what they found.
"""

from collections.abc import Callable, Iterator
from typing import Any, Final

from pydantic import ValidationError

from robotapp_api.checks.device_names import handover_notes
from robotapp_api.checks.host_access.guarded import host_access_notes
from robotapp_api.checks.problem import Note
from robotapp_api.checks.size import size_problem
from robotapp_api.checks.spec import pool_notes, spec_notes, spec_problems
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.values.label_key import key_problem
from robotapp_cli.lint.cel_rules import broken_rules
from robotapp_cli.lint.findings import Finding, Path, Severity, Why, steps
from robotapp_cli.lint.marks import describe_mark
from robotapp_cli.lint.structure import empty_fields, list_keys, structure
from robotapp_cli.lint.subject import Subject

Check = Callable[[Subject], Iterator[Finding]]


def written_status(subject: Subject) -> Iterator[Finding]:
    """A status in a file, such as one that kubectl get wrote."""
    if "status" in subject.written:
        text = "status is what the operator observes, and the API server ignores it in a file; remove it"
        yield Finding(("status",), text, Severity.WARNING, Why.IGNORED_FIELD, at_key=True)


def metadata_keys(subject: Subject) -> Iterator[Finding]:
    """Keys of labels and annotations that the API server refuses; of a template's, the rules and the operator's checks."""
    for field in ("labels", "annotations"):
        entries = _metadata(subject).get(field)
        for key in entries if isinstance(entries, dict) else ():
            # the API server ignores the case of an annotation's key
            if problem := key_problem(key.lower() if field == "annotations" else key):
                yield Finding(("metadata", field, key), problem, reason=Why.WRONG_VALUE, at_key=True)


def rules(subject: Subject) -> Iterator[Finding]:
    """The rules of the definition, with the message the API server shows."""
    known = _refused(subject)
    for broken in broken_rules(subject.definition.schema, subject.stored, unsound=subject.unsound):
        if broken.path not in known:  # a value that does not fit its pattern breaks rules as well
            yield Finding(broken.path, broken.shown, reason=broken.reason or Why.BROKEN_RULE)


def operator_problems(subject: Subject) -> Iterator[Finding]:
    """What the operator would refuse with Accepted=False."""
    spec, known = _spec(subject), _refused(subject)
    stored = subject.stored.get("spec")
    if isinstance(stored, dict) and (too_large := size_problem(stored)):
        yield Finding(steps(too_large.field), too_large.message, reason=too_large.reason)
    for problem in spec_problems(spec) if spec else ():
        path = steps(problem.field)
        if path not in known:  # else a rule of the definition has found it already
            yield Finding(path, problem.message, reason=problem.reason)


def operator_notes(subject: Subject) -> Iterator[Finding]:
    """What the operator accepts but cannot do yet."""
    for note in _notes(subject):
        yield Finding(steps(note.field), note.message, Severity.WARNING, Why.NOTE)


def names_itself(subject: Subject) -> Iterator[Finding]:
    """An app that shares its domain with itself: to the operator it leads a ring of one. A spec alone does not have the name."""
    spec, metadata = _spec(subject), _metadata(subject)
    for index, other in enumerate(spec.ros2.share_with if spec and spec.ros2 else ()):
        if other.name == metadata.get("name") and other.namespace in ("", metadata.get("namespace")):
            text = f"{other.name} is this app itself, so no domain is shared; write the name of the other app"
            yield Finding(("spec", "ros2", "shareWith", index), text, Severity.WARNING, Why.NOTE)


def marked_places(subject: Subject) -> Iterator[Finding]:
    """Places that an import marked for a person to fill in; where another check refuses the value, its words count."""
    spec = subject.stored.get("spec")
    pending: list[tuple[Path, Any]] = [(("spec",), spec)]
    refused = _refused(subject)
    while pending:
        path, value = pending.pop()
        if isinstance(value, dict):
            pending += [((*path, name), inner) for name, inner in value.items()]
        elif isinstance(value, list):
            pending += [((*path, index), inner) for index, inner in enumerate(value)]
        elif isinstance(value, str) and path not in refused and (text := describe_mark(value)):
            yield Finding(path, text, reason=Why.MARKED)


CHECKS: Final[tuple[Check, ...]] = (
    written_status,
    structure,
    empty_fields,
    list_keys,
    metadata_keys,
    rules,
    operator_problems,
    operator_notes,
    names_itself,
    marked_places,
)


def _metadata(subject: Subject) -> dict[str, Any]:
    """As written; without anything where it is no mapping."""
    metadata = subject.stored.get("metadata")
    return metadata if isinstance(metadata, dict) else {}


def _notes(subject: Subject) -> Iterator[Note]:
    if spec := _spec(subject):
        yield from spec_notes(spec)
        yield from host_access_notes(spec)
        for index, component in enumerate(spec.components):
            yield from handover_notes(component, f"spec.components[{index}]")
    if subject.definition.kind == "DomainPool" and not subject.unsound and not _refused(subject):
        yield from pool_notes(max_participants_per_host=subject.stored["spec"]["maxParticipantsPerHost"])


def _refused(subject: Subject) -> set[Path]:
    """Where the checks before found an error."""
    return {finding.path for finding in subject.found if finding.severity is Severity.ERROR}


def _spec(subject: Subject) -> RobotAppSpec | None:
    """The spec of a RobotApp as the operator reads it; None where it is not complete."""
    if subject.definition.kind != "RobotApp" or subject.unsound:
        return None
    try:
        return RobotAppSpec.model_validate(subject.stored["spec"])
    except ValidationError:
        if _refused(subject):
            return None
        raise
