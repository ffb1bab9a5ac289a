"""Fifty ways to write a pod's scheduler.robotics.io annotations wrongly, each with what the refusal must name."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from robotapp_api.model.names import SCHEDULER_NAME, Annotation


@dataclass(frozen=True, slots=True)
class Wrong:
    """One annotation with one mistake. The message must contain key, `field` (if any), `shown` and `allowed`."""

    key: Annotation
    text: str
    field: str
    shown: str
    allowed: str

    def __str__(self) -> str:
        return f"{self.key}: {self.text[:60]}"


def malformed_annotations() -> list[Wrong]:
    """All of them, in a fixed order."""
    return [*_values(), *_unknown_fields(), *_broken_json(), *_domains()]


def pod(name: str, wrong: Wrong) -> dict[str, Any]:
    """A pod that only lacks a correct annotation."""
    return {
        "metadata": {"name": name, "annotations": {str(wrong.key): wrong.text}},
        "spec": {
            "schedulerName": SCHEDULER_NAME,
            "containers": [{"name": "main", "image": "registry.example/bare:1"}],
        },
    }


_LONG_LIST = ["zone"] * 33
_DURATION = "30ms"
_FIELDS: dict[Annotation, dict[str, tuple[str, list[Any]]]] = {
    Annotation.POLICIES: {
        "latency_budget": (_DURATION, ["30", 30, "-5ms", "0ms", "fast", ""]),
        "deadline": (_DURATION, ["50 ms", [], "1e3ms"]),
        "qos_class": ("realtime", ["Realtime", "high", 1]),
        "reliability": ("best_effort", ["Reliable", True]),
        "durability": ("transient_local", ["persistent"]),
        "liveliness": ("manual_by_topic", ["manual"]),
        "queue_size": ("integer", [-1, "10", 1.5, True, 99_999_999]),
        "tcp_nodelay": ("true or false", ["yes", 1]),
    },
    Annotation.TOPOLOGY: {
        "master_node": ("string", [7]),
        "preferred_zones": ("list", ["hall-1", _LONG_LIST]),
        "preferred_zones[0]": ("string", [1, ""]),
    },
    Annotation.AFFINITY: {
        "hardware_requirements": ("list", ["gpu"]),
        "hardware_requirements[0]": ("object", [7]),
        "hardware_requirements[0].type": ("gpu", [{}, {"model": "nvidia"}]),
        "hardware_requirements[0].vendor": ("interface", [{"type": "usb", "vendor": "intel"}]),
    },
    Annotation.SHARED_DATA: {
        "peer_pods": ("list", ["mapper"]),
        "peer_pods[0]": ("string", [None]),
        "pvc": ("list", [{}]),
    },
}


def _values() -> Iterator[Wrong]:
    for key, fields in _FIELDS.items():
        for field, (allowed, values) in fields.items():
            name, is_item, _ = field.partition("[0]")
            for value in values:
                text = json.dumps({name: [value] if is_item else value})
                yield Wrong(key, text, field, _shown(value, field), allowed)


def _shown(value: Any, field: str) -> str:
    """The beginning of what is wrong, as it stands in the annotation."""
    if isinstance(value, dict) and "." in field:
        value = value.get(field.rpartition(".")[2])
    return json.dumps(value)[:20]


def _unknown_fields() -> Iterator[Wrong]:
    yield Wrong(Annotation.POLICIES, '{"latencyBudget": "30ms"}', "latencyBudget", "30ms", "latency_budget")
    yield Wrong(Annotation.TOPOLOGY, '{"zones": ["hall-1"]}', "zones", "hall-1", "preferred_zones")
    yield Wrong(Annotation.AFFINITY, '{"hardware": []}', "hardware", "[]", "hardware_requirements")
    yield Wrong(Annotation.SHARED_DATA, '{"peerPods": []}', "peerPods", "[]", "peer_pods")
    yield Wrong(Annotation.POLICIES, '{"formatVersion": 1}', "formatVersion", "1", "latency_budget")


def _broken_json() -> Iterator[Wrong]:
    key = Annotation.POLICIES
    for text in ("", "{", "latency_budget: 30ms", '{"deadline": 50ms}'):
        yield Wrong(key, text, "", text[:10], "JSON object")
    for text in ("[]", "7", "null"):
        yield Wrong(key, text, "", text, "a JSON object")
    yield Wrong(key, '{"deadline": "1s", "deadline": "2s"}', "deadline", "2s", "once")
    yield Wrong(key, '{"queue_size": NaN}', "", "NaN", "numbers")
    yield Wrong(key, '{"deadline": ' + "[" * 9 + "]" * 9 + "}", "", "[[[", "levels")
    yield Wrong(Annotation.TOPOLOGY, json.dumps({"master_node": "n" * 9000}), "", "nnn", "8192 bytes")


def _domains() -> Iterator[Wrong]:
    for text in ("7a", "233", "0", "150", "-1", "Auto", "", "7.0", "٣"):  # the last is an Arabic-Indic three
        yield Wrong(Annotation.DDS_DOMAIN, text, "", text, "auto")
