"""values.schema.json and values.yaml say the same: every key is described, closed and has a default."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

CHART = Path(__file__).resolve().parents[3] / "helm" / "robotapp"
SCHEMA = json.loads((CHART / "values.schema.json").read_text())
VALUES = yaml.safe_load((CHART / "values.yaml").read_text())

PODS = ("operator", "scheduler", "agent", "agent.labeller", "console")
# Passed on to Kubernetes as they stand; the API server (or the scheduler, for its config) checks them.
PASSED_ON = {
    "global",
    *(f"{part}.{key}" for part in PODS for key in ("resources", "affinity")),
    *("agent.driver.resources", "scheduler.config"),
}
# What a person may take away with null: the pod then has neither requests nor limits, no selector, the image's or cluster's user.
REMOVABLE = {
    *(f"{part}.{key}" for part in PODS for key in ("resources", "nodeSelector")),
    *("agent.affinity", "agent.driver.resources", "podSecurity.runAsUser", "podSecurity.runAsGroup"),
}
# Whose absence says something: a namespace without a quota is unlimited, and no umbrella chart switches ours.
ABSENT = {"domainPool.quota.default", "enabled"}
KINDS: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
}


def walk(schema: dict[str, Any], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    for key, child in schema.get("properties", {}).items():
        where = f"{path}.{key}" if path else key
        resolved = SCHEMA["$defs"][child["$ref"].rpartition("/")[2]] if "$ref" in child else child
        yield where, resolved
        if where not in PASSED_ON:
            yield from walk(resolved, where)


DESCRIBED = dict(walk(SCHEMA))


def default_of(path: str) -> Any:
    node = VALUES
    for key in path.split("."):
        node = node[key]
    return node


def test_unknown_keys_are_refused_at_every_level() -> None:
    open_objects = {
        path
        for path, schema in DESCRIBED.items()
        if schema["type"] == "object" and schema.get("additionalProperties", True) is True and path not in PASSED_ON
    }
    assert open_objects == set()
    assert SCHEMA["additionalProperties"] is False


@pytest.mark.parametrize("path", sorted(DESCRIBED))
def test_every_value_is_described_by_a_sentence(path: str) -> None:
    text = DESCRIBED[path]["description"]
    assert text.endswith(".")
    assert " " in text


@pytest.mark.parametrize("path", sorted(set(DESCRIBED) - {"global"} - ABSENT))
def test_every_described_value_has_a_default_of_its_type(path: str) -> None:
    assert isinstance(default_of(path), KINDS[DESCRIBED[path]["type"]])


def test_every_default_is_described() -> None:
    def keys(node: dict[str, Any], path: str = "") -> Iterator[str]:
        for key, child in node.items():
            where = f"{path}.{key}" if path else key
            yield where
            if isinstance(child, dict) and where not in PASSED_ON and "properties" in DESCRIBED.get(where, {}):
                yield from keys(child, where)

    assert set(keys(VALUES)) <= set(DESCRIBED)


def test_a_value_whose_default_says_something_is_not_emptied() -> None:
    """A key with nothing behind it takes the default away; templates would stop in the middle, or leave out what it says."""
    needed = {path for path in DESCRIBED if path not in {"global", *REMOVABLE, *ABSENT} and default_of(path)}
    objects = {"": SCHEMA} | {path: schema for path, schema in DESCRIBED.items() if path not in PASSED_ON}
    required = {f"{path}.{key}".lstrip(".") for path, schema in objects.items() for key in schema.get("required", ())}
    assert required == needed
