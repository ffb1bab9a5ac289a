"""Measures a RobotApp: what it costs the operator, which keeps every app in its memory, suspended ones too."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from robotapp_api.checks.problem import Problem
from robotapp_api.model.names import Reason

MOST_BYTES: Final = 512 * 1024
COMPONENT_BYTES: Final = 4096
PART_BYTES: Final = 1024
WORD_BYTES: Final = 96
_PARTS: Final = ("devices", "requires", "parameters", "dependsOn")
_WORDS: Final = ("command", "args", "colocateWith", "separateFrom")


class SpecSize(NamedTuple):
    """`text_bytes`: of the spec as JSON. `parts`: edges, devices, requirements, dependencies, parameter files, overrides and their components. `words`: of command and args, labels,
    annotations and node selectors.
    """

    text_bytes: int
    components: int
    parts: int
    words: int

    @property
    def total_bytes(self) -> int:
        """Returns about the memory that the spec takes for as long as the app exists."""
        return self.text_bytes + self.components * COMPONENT_BYTES + self.parts * PART_BYTES + self.words * WORD_BYTES


def measure_spec(spec: Mapping[str, Any]) -> SpecSize:
    """Measures a spec as it is stored; whatever is no list or object counts as its text alone."""
    components = [item for item in _items(spec.get("components")) if isinstance(item, Mapping)]
    recordings = _items(spec.get("recordings"))  # each becomes a component
    overrides = [item for item in _items(spec.get("overrides")) if isinstance(item, Mapping)]
    changed = [part for item in overrides for part in _items(item.get("components")) if isinstance(part, Mapping)]
    parts = len(_items(spec.get("edges"))) + len(overrides) + len(changed)
    parts += sum(len(_items(item.get(name))) for item in (*components, *changed) for name in _PARTS)
    text = json.dumps(spec, separators=(",", ":"), ensure_ascii=False)
    size = len(text.encode("utf-8", "surrogatepass"))
    return SpecSize(size, len(components) + len(recordings), parts, sum(map(_count_words, components)))


def size_problem(spec: Mapping[str, Any]) -> Problem | None:
    """Decides whether a spec is too large, with what counts how much."""
    size = measure_spec(spec)
    if size.total_bytes <= MOST_BYTES:
        return None
    counts = ", ".join(
        f"{number} {name} {number * each // 1024} KiB"
        for number, name, each in (
            (size.components, "components", COMPONENT_BYTES),
            (size.parts, "edges, devices, requirements, dependencies, parameter files and overrides", PART_BYTES),
            (size.words, "words, labels and annotations", WORD_BYTES),
        )
        if number
    )
    text = (
        f"the app counts {size.total_bytes // 1024} KiB, at most {MOST_BYTES // 1024} KiB are allowed: its text {size.text_bytes // 1024} KiB, "
        f"{counts}; keep parameter files in ConfigMaps (configMapKeyRef), environment too (envFrom), or make several apps of it"
    )
    return Problem(Reason.TOO_LARGE, "spec", text)


def _count_words(component: Mapping[str, Any]) -> int:
    template = _fields(component.get("template"))
    metadata, pod = _fields(template.get("metadata")), _fields(template.get("spec"))
    run, launch = _fields(component.get("run")), _fields(component.get("launch"))
    maps = (
        metadata.get("labels"),
        metadata.get("annotations"),
        pod.get("nodeSelector"),
        run.get("remaps"),
        launch.get("arguments"),
    )
    words = sum(len(_items(component.get(name))) for name in _WORDS) + len(_items(run.get("args")))
    return words + 2 * sum(len(_fields(value)) for value in maps)


def _items(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list | tuple) else ()


def _fields(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
