"""`x-robotapp` in a compose file: what compose has no words for, in those of RobotApp. docker compose passes over it."""

from typing import Any, Final

from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.files.project import EXTENSION
from robotapp_cli.importing.services.draft import Context, Draft, Json

_OF_SERVICE: Final = {"name": "the component has the name of the service; rename the service"}
_OF_FILE: Final = {"components": f"each service is a component; write its fields under {EXTENSION} of the service"}


def extend_component(draft: Draft) -> Json:
    """Returns the component with the fields that the service states in RobotApp's words. Raises ComposeError."""
    return _extend(draft.assemble(), draft.service.get(EXTENSION), draft.context, "the component", _OF_SERVICE)


def extend_spec(context: Context, spec: Json) -> Json:
    """Returns the spec with the fields that the file states in RobotApp's words. Raises ComposeError."""
    return _extend(spec, context.project.extension, context, "spec", _OF_FILE)


def _extend(value: Json, part: Part | None, context: Context, place: str, refused: dict[str, str]) -> Json:
    if part is None:
        return value
    for name, field in part.as_fields().items():
        if name in refused:
            raise field.fail(refused[name])
    context.report.take(part, f"laid over {place}")
    component: Json = _lay_over(value, part)
    return component


def _lay_over(value: Any, part: Part) -> Any:
    """Merges as JSON Merge Patch (RFC 7396): mappings field by field, null removes, everything else replaces."""
    if part.unset:
        raise part.fail("a value is needed here")
    if part.items is not None:
        return [_lay_over(None, item) for item in part.items]
    if part.fields is None:
        return part.scalar
    fields = dict(value) if isinstance(value, dict) else {}
    for name, field in part.fields.items():
        if field.scalar is None and field.fields is None and field.items is None:
            fields.pop(name, None)
        else:
            fields[name] = _lay_over(fields.get(name), field)
    return fields
