"""Whether objects have the shape in which the API server writes them, as far as a migration reads them. Pure.

What kubectl gives is the API server's; a file is whatever somebody wrote.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

Check = Callable[[Any], str | None]
"""The path of the first part that has another shape, which is empty for the value itself; None when all is well."""


def misshapen(obj: Any) -> str | None:
    """`.spec.template` when that is where an object has another shape; None when a migration can read it."""
    found = _HEAD(obj)
    return found if found is not None else _KINDS.get(obj["kind"], _HEAD)(obj)


def _of(kind: type, *, or_none: bool = False) -> Check:
    def check(value: Any) -> str | None:
        fits = isinstance(value, kind) and not (kind is int and isinstance(value, bool))
        return None if fits or (or_none and value is None) else ""

    return check


def _all(check: Check, *, least: int = 0) -> Check:
    def checked(value: Any) -> str | None:
        if not isinstance(value, list) or len(value) < least:
            return ""
        wrong = ((index, check(one)) for index, one in enumerate(value))
        return next((f"[{index}]{path}" for index, path in wrong if path is not None), None)

    return checked


def _texts(value: Any) -> str | None:
    items = value.items() if isinstance(value, dict) else [] if value is None else [("", None)]
    return next((f".{key}" for key, one in items if not isinstance(one, str)), None)


def _has(required: Mapping[str, Check], **optional: Check) -> Check:
    def check(value: Any) -> str | None:
        if not isinstance(value, dict):
            return ""
        missing = [f".{key}" for key in required if key not in value]
        checks = {**required, **optional}
        wrong = ((key, checks[key](one)) for key, one in value.items() if key in checks)
        return next(iter(missing), None) or next((f".{key}{path}" for key, path in wrong if path is not None), None)

    return check


_TEXT: Final = _of(str)
_NAMED: Final = _has({"name": _TEXT})
_OWNER: Final = _has({"uid": _TEXT}, kind=_TEXT)
_METADATA: Final = _has(
    {"name": _TEXT}, namespace=_TEXT, uid=_TEXT, labels=_texts, annotations=_texts, ownerReferences=_all(_OWNER)
)
_HEAD: Final = _has({"kind": _TEXT, "metadata": _METADATA})
_SOURCE: Final = _has({}, name=_TEXT, key=_TEXT, fieldPath=_TEXT)
_VALUE_FROM: Final = _has({}, configMapKeyRef=_SOURCE, secretKeyRef=_SOURCE, fieldRef=_SOURCE)
_VARIABLE: Final = _has({"name": _TEXT}, value=_TEXT, valueFrom=_VALUE_FROM)
_ENV_FROM: Final = _has({}, prefix=_TEXT, configMapRef=_SOURCE, secretRef=_SOURCE)
_CONTAINER: Final = _has(
    {"name": _TEXT},
    image=_TEXT,
    command=_all(_TEXT),
    args=_all(_TEXT),
    env=_all(_VARIABLE),
    envFrom=_all(_ENV_FROM),
    volumeMounts=_all(_NAMED),
)
_POD: Final = _has({"containers": _all(_CONTAINER, least=1)}, schedulerName=_TEXT, volumes=_all(_NAMED))
_TEMPLATE: Final = _has({"spec": _POD}, metadata=_has({}, labels=_texts, annotations=_texts))
_WORKLOAD: Final = _has({"spec": _has({"template": _TEMPLATE}, replicas=_of(int))})
_KINDS: Final = {
    "Pod": _has({"spec": _POD}),
    "ConfigMap": _has({}, data=_of(dict, or_none=True)),
    **dict.fromkeys(("Deployment", "StatefulSet", "DaemonSet", "Job"), _WORKLOAD),
}
