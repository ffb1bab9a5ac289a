"""Schema of the fields borrowed from PodSpec and Container, cut from the OpenAPI of the pinned API server.

    kubectl get --raw /openapi/v3/api/v1 | python -m robotapp_api.schema.vendor v1.37.1

writes `core_v1.json`. Added: bounds. Left out: what an app must not reach (addresses of host ports, other volume types),
defaults that only restate "absent", and all but the first sentence of each description.
"""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.markers import CORE_KEYWORD
from robotapp_api.model.scalars import QUANTITY_SCHEMA

Schema = dict[str, Any]

FILE: Final = Path(__file__).with_name("core_v1.json")
_CORE: Final = "io.k8s.api.core.v1."
_REF: Final = "#/components/schemas/"
_VOLUMES: Final = {
    "name", "configMap", "secret", "emptyDir", "persistentVolumeClaim", "projected", "downwardAPI", "hostPath", "nfs", "csi",
}  # fmt: skip
_LEFT_OUT: Final = {"ContainerPort": {"hostIP"}, "ResourceRequirements": {"claims"}}
_KEPT: Final = (
    "format",
    "enum",
    "minimum",
    "maximum",
    "x-kubernetes-list-type",
    "x-kubernetes-list-map-keys",
    "x-kubernetes-map-type",
)
_MAX_LENGTH: Final = {"value": 32_768, "name": 253, "key": 317, "command": 4_096, "args": 4_096, "data": 32_768}
_MAX_ITEMS: Final = {"env": 128, "args": 128, "envFrom": 16, "initContainers": 8, "containers": 8}
_BOUNDS: Final = {"containerPort": {"minimum": 1, "maximum": 65_535}, "hostPort": {"minimum": 0, "maximum": 65_535}}
"""What the API server checks beside its OpenAPI."""
_INT_OR_STRING: Final = {
    "x-kubernetes-int-or-string": True,
    "anyOf": [{"type": "integer"}, {"type": "string"}],
    "maxLength": 63,
}
_SENTENCE: Final = re.compile(r"(.+?(?<!e\.g)(?<!i\.e)(?<!etc)[.])(\s|$)", re.DOTALL)


def wanted() -> list[str]:
    """The borrowed fields the models name, such as Container.env."""
    return sorted(set(_markers(RobotApp.model_json_schema())))


def _markers(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        if CORE_KEYWORD in node:
            yield node[CORE_KEYWORD]
        for value in node.values():
            yield from _markers(value)
    elif isinstance(node, list):
        for value in node:
            yield from _markers(value)


def extract(openapi: Schema, version: str) -> Schema:
    """The vendored document: {"server": version, "fields": {"Container.env": schema, …}}."""
    source = _Source(openapi["components"]["schemas"])
    fields = {}
    for path in wanted():
        kind, field = path.split(".")
        fields[path] = source.convert(source.definitions[_CORE + kind]["properties"][field], name=field)
    return {"server": version, "fields": fields}


class _Source:
    """Definitions of one OpenAPI document. Conversion inlines references; a recursive type ends as RecursionError."""

    def __init__(self, definitions: Schema) -> None:
        self.definitions = definitions

    def convert(self, node: Schema, *, name: str) -> Schema:
        own_text = node.get("description", "")
        target, kind = self._resolved(node)
        text = _first_sentence(own_text or target.get("description", ""))
        result: Schema = {"description": text} if text else {}
        if kind.endswith(".Quantity"):
            return result | QUANTITY_SCHEMA
        if kind.endswith(".IntOrString"):
            return result | _INT_OR_STRING
        result["type"] = target.get("type", "object")
        result |= {key: target[key] for key in _KEPT if key in target}
        if result["type"] == "object":
            result |= self._members(target, kind.removeprefix(_CORE), name=name)
        elif result["type"] == "array":
            result |= {"items": self.convert(target["items"], name=name), "maxItems": _MAX_ITEMS.get(name, 64)}
            _require_keys(result)
        elif name in _BOUNDS:
            result |= _BOUNDS[name]
        elif result["type"] == "string" and "enum" not in target:
            result["maxLength"] = _MAX_LENGTH.get(name, 1_024)
        if target.get("default") or node.get("default"):
            result["default"] = target.get("default") or node.get("default")
        return result

    def _resolved(self, node: Schema) -> tuple[Schema, str]:
        """The node behind references, and the name of the last one."""
        kind = ""
        while (
            inner := node.get("$ref") or next((part.get("$ref") for part in node.get("allOf", ())), None)
        ) is not None:
            kind = inner.removeprefix(_REF)
            node = self.definitions[kind]
        return node, kind

    def _members(self, target: Schema, kind: str, *, name: str) -> Schema:
        if "additionalProperties" in target:
            return {
                "additionalProperties": self.convert(target["additionalProperties"], name=name),
                "maxProperties": 64,
            }
        left_out = _LEFT_OUT.get(kind, set())
        properties = {
            key: self.convert(value, name=key)
            for key, value in sorted(target.get("properties", {}).items())
            if key not in left_out and (kind != "Volume" or key in _VOLUMES)
        }
        required = sorted(target.get("required", ()))
        return {"properties": properties} | ({"required": required} if required else {})


def _require_keys(array: Schema) -> None:
    """Keys of a list-map must be required or have a default, which core replaces by `default: ""`."""
    items = array["items"]
    missing = [key for key in array.get("x-kubernetes-list-map-keys", ()) if "default" not in items["properties"][key]]
    if missing:
        items["required"] = sorted({*items.get("required", ()), *missing})


def _first_sentence(text: str) -> str:
    flat = " ".join(text.split())
    match = _SENTENCE.match(flat)
    return match[1] if match else flat


def render(document: Schema) -> str:
    """The text of `core_v1.json`."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def main() -> None:
    """Reads the OpenAPI document of core/v1 from standard input; the argument is the server's version."""
    FILE.write_text(render(extract(json.load(sys.stdin), sys.argv[1])))


if __name__ == "__main__":
    main()
