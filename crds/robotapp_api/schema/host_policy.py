"""The table of guarded fields in CEL: variables of the chart's policies, which ask the authorizer about each right."""

from typing import Any, Final

from robotapp_api.checks.host_access.table import (
    APPARMOR_PREFIX,
    FREE_APPARMOR,
    FREE_APPARMOR_PREFIX,
    GUARDED,
    GuardedField,
    HostRight,
    Level,
)

_PODS: Final = (
    "(variables.spec.?components.orValue([]).map(c, {'owner': dyn('component ' + c.?name.orValue('')), 'own': dyn(c)})"
    " + [{'owner': dyn('ros2.discovery'), 'own': dyn(variables.spec.?ros2.?discovery.orValue({}))},"
    " {'owner': dyn('ros1'), 'own': dyn(variables.spec.?ros1.orValue({}))}])"
    ".map(p, {'owner': p.owner, 'pod': dyn(p.own.?template.?spec.orValue({})),"
    " 'annotations': dyn(p.own.?template.?metadata.?annotations.orValue({})),"
    " 'containers': dyn([p.own] + p.own.?template.?spec.?containers.orValue([])"
    " + p.own.?template.?spec.?initContainers.orValue([]))})"
)
"""Pods of a spec: components, discovery servers or router, master; each with the containers that are written for it."""

_SETS: Final = {
    values: f"free{number}"
    for number, values in enumerate(dict.fromkeys(field.free for field in GUARDED if len(field.free) > 1))
}
"""Free values of fields that have several, by the variable that holds them."""


def policy_variables() -> list[dict[str, str]]:
    """Returns variables of a ValidatingAdmissionPolicy that has the spec as `variables.spec`.

    The variable named like a right is the sentence about the first field that takes it, '' for none. Each field has a variable
    of its own, because what one expression may cost is limited.
    """
    variables = [{"name": "pods", "expression": _PODS}]
    variables += [{"name": name, "expression": _set_of(values)} for values, name in _SETS.items()]
    for number, field in enumerate(GUARDED):
        expression = f"variables.pods.filter(p, {_guards(field)})"
        variables.append({"name": _name(number), "expression": expression})
    variables += [{"name": right.value, "expression": _sentence(right)} for right in HostRight]
    return variables


def policy_data() -> dict[str, Any]:
    """Returns what the chart reads: the rights, and the variables that find the fields which take them."""
    return {"rights": [right.value for right in HostRight], "variables": policy_variables()}


def bridge_data() -> list[dict[str, Any]]:
    """Returns the table as the Rigel bridge ships it, which imports none of our packages."""
    return [
        {"path": field.path, "level": field.level.value, "effect": field.effect, "free": list(field.free)}
        for field in GUARDED
        if field.level is not Level.ANNOTATIONS
    ]


def _name(number: int) -> str:
    return f"guarded{number}"


def _sentence(right: HostRight) -> str:
    """Returns the expression of the sentence about the first field that takes a right."""
    parts = [
        f"size(variables.{_name(number)}) > 0 ? variables.{_name(number)}[0].owner + ' {field.effect} ({field.name})' : "
        for number, field in enumerate(GUARDED)
        if field.right is right
    ]
    return "".join(parts) + "''"


def _guards(field: GuardedField) -> str:
    """Returns the condition on a pod `p` that has the field with a value that is not free."""
    if field.level is Level.ANNOTATIONS:
        value = "p.annotations[k]"
        return (
            f"p.annotations.exists(k, k.startsWith('{APPARMOR_PREFIX}') && !({value} in {list(FREE_APPARMOR)})"
            f" && !{value}.startsWith('{FREE_APPARMOR_PREFIX}'))"
        )
    steps = field.path.split(".")
    if field.level is Level.POD:
        return _condition("p.pod", steps, field, depth=0)
    return f"p.containers.exists(k, {_condition('k', steps, field, depth=0)})"


def _condition(holder: str, steps: list[str], field: GuardedField, *, depth: int) -> str:
    names: list[str] = []
    for index, step in enumerate(steps):
        names.append(step.removesuffix("[]"))
        if step.endswith("[]"):
            item = f"i{depth}"
            items = f"{holder}{_select(names)}.orValue([])"
            rest = steps[index + 1 :]
            inner = _condition(item, rest, field, depth=depth + 1) if rest else _is_not_free(item, field)
            return f"{items}.exists({item}, {inner})"
    if not field.free:
        return f"{holder}{_select(names)}.hasValue()"
    return _is_not_free(f"{holder}{_select(names)}.orValue({_literal(field.free[0])})", field)


def _is_not_free(value: str, field: GuardedField) -> str:
    """Returns the condition that a value is none of the field's free ones. A list literal would cost ten at every comparison."""
    if len(field.free) == 1:
        return f"{value} != {_literal(field.free[0])}"
    return f"!({value} in variables.{_SETS[field.free]})"


def _select(names: list[str]) -> str:
    return "".join(f".?{name}" for name in names)


def _set_of(values: tuple[str | int | bool, ...]) -> str:
    """Returns a map of which the values are the keys: a look-up costs one, in a list as much as the list is long."""
    return f"{{{', '.join(f'{_literal(value)}: true' for value in values)}}}"


def _literal(value: str | int | bool) -> str:
    return f"'{value}'" if isinstance(value, str) else str(value).lower()
