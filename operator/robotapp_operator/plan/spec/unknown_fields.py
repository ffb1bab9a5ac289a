"""Fields of a spec that this version does not have: a newer CRD stores them, and they do nothing here. Pure.

So it is after `helm rollback` of the programs alone, and for a moment in each upgrade, whose CRDs come first.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from robotapp_api.model.base import Model

MOST: Final = 8


def find_unknown_fields(model: Model, body: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the paths of fields that `body` has and `model`, which was parsed from it, does not, each once and at most `MOST`.

    Fields of Kubernetes' own types are not looked into: the API server of the cluster knows which there are.
    """
    paths: dict[str, None] = {}
    for path in _walk(model, body, "spec"):
        paths.setdefault(path)
        if len(paths) == MOST:
            break
    return tuple(paths)


def _walk(value: Any, written: Any, path: str) -> Iterator[str]:
    if isinstance(value, Model) and isinstance(written, Mapping):
        names = {field.alias or name: name for name, field in type(value).model_fields.items()}
        for key, part in written.items():
            if key not in names:
                yield f"{path}.{key}"
            elif isinstance(part, Mapping | list):
                yield from _walk(getattr(value, names[key]), part, f"{path}.{key}")
    elif isinstance(value, tuple) and isinstance(written, list):
        for item, part in zip(value, written, strict=False):
            yield from _walk(item, part, f"{path}[]")
