"""Objects other than pods that nobody should send, by the plural of their resource: huge, absurd, or of the wrong kind."""

from typing import Any, Final

from tests.support.scheduler.poison import MANY, long_selector

Json = dict[str, Any]


def _meta(name: str, **more: Any) -> Json:
    return {"name": name, "namespace": "default", "uid": f"uid-{name}", "resourceVersion": "1", **more}


def _labels() -> dict[str, str]:
    return {f"k{number}": "v" for number in range(MANY)}


def _node(name: str, **parts: Any) -> Json:
    status = {"allocatable": {"cpu": "1", "memory": "1Gi", "pods": "5", **parts.get("offers", {})}}
    return {
        "metadata": {**_meta(name), "labels": parts.get("labels", {}), "annotations": parts.get("annotations", {})},
        "spec": {"taints": parts.get("taints", [])},
        "status": {**status, "images": parts.get("images", [])},
    }


def _taints(effect: str) -> list[Json]:
    return [{"key": f"k{number}", "effect": effect} for number in range(MANY)]


NODES: Final = (
    _node("labels", labels=_labels()),
    _node("taints", taints=_taints("NoSchedule")),
    _node("soft-taints", taints=_taints("PreferNoSchedule")),
    _node("resources", offers={f"x.example/r{number}": "1" for number in range(MANY)}),
    _node("quantity", offers={"cpu": "lots"}),
    _node("negative", offers={"cpu": "-5", "memory": "-1"}),
    _node("pods", offers={"pods": "9" * 30}),
    _node("images", images=[{"names": [f"reg/i{n}:1"], "sizeBytes": 2**62} for n in range(MANY)]),
    _node("image", images=[{"names": ["registry.invalid/main:1"], "sizeBytes": -(2**62)}]),
    _node("annotations", annotations=_labels()),
)
_REQUESTS: Final = {"requests": {"storage": "1e400"}}
_TERMS: Final = [{"matchExpressions": [{"key": f"k{n}", "operator": "In", "values": ["a"]}]} for n in range(MANY)]

POISON_OBJECTS: Final[dict[str, tuple[Json, ...]]] = {
    "nodes": NODES,
    "services": (
        {"metadata": _meta("labels"), "spec": {"selector": _labels()}},
        {"metadata": _meta("number"), "spec": {"selector": {"a": 5}}},
        {"metadata": _meta("object"), "spec": {"selector": {"a": {"b": [1]}}}},
    ),
    "replicasets": (
        {"metadata": _meta("long"), "spec": {"selector": long_selector(MANY)}},
        {"metadata": _meta("text"), "spec": {"selector": {"matchExpressions": "all"}}},
        {"metadata": _meta("list"), "spec": {"selector": {"matchLabels": [1]}}},
    ),
    "namespaces": ({"metadata": {"name": "n", "uid": "n", "labels": _labels()}},),
    "poddisruptionbudgets": (
        {
            "metadata": _meta("long"),
            "spec": {"selector": long_selector(MANY)},
            "status": {"disruptionsAllowed": 2**70, "disruptedPods": _labels()},
        },
        {"metadata": _meta("number"), "spec": {"selector": {"matchLabels": 7}}},
    ),
    "persistentvolumeclaims": (
        {"metadata": _meta("huge"), "spec": {"resources": _REQUESTS, "storageClassName": "x" * 100_000}},
        {"metadata": _meta("text"), "spec": {"resources": {"requests": {"storage": "lots"}}}},
    ),
    "persistentvolumes": (
        {"metadata": _meta("nan"), "spec": {"capacity": {"storage": "NaN"}}},
        {"metadata": _meta("terms"), "spec": {"nodeAffinity": {"required": {"nodeSelectorTerms": _TERMS}}}},
    ),
    "csinodes": (
        {
            "metadata": _meta("n1"),
            "spec": {"drivers": [{"name": f"d{n}", "allocatable": {"count": 2**40}} for n in range(MANY)]},
        },
    ),
    "robotapps": (
        {
            "metadata": _meta("app", generation=1),
            "spec": {
                "components": [{"name": f"c{n}", "image": "i", "runsOn": ["Boat"] * 9} for n in range(MANY)],
                "edges": [
                    {"kind": "Telepathy", "topic": "/t", "from": "c0", "to": f"c{n}", "latency": {"budget": "1e400s"}}
                    for n in range(MANY)
                ],
            },
            "status": {"observedGeneration": 1},
        },
    ),
    "robotclaims": (
        {"metadata": _meta("dds.x"), "spec": {"domain": {"pool": "p", "id": 2**80}, "holder": {"uid": "z"}}},
    ),
    "nodetelemetries": (
        {
            "metadata": _meta("n1"),
            "status": {
                "intervalSeconds": 1e308,
                "rtt": [
                    {"peer": f"n{n}", "p50Us": 2**70, "p95Us": -1, "lossPPM": 2**70, "seq": -1} for n in range(MANY)
                ],
                "devices": [{"id": f"d{n}", "type": "can"} for n in range(MANY)],
            },
        },
    ),
    "podgroups": (
        {"metadata": _meta("most"), "spec": {"minMember": 2**70, "scheduleTimeoutSeconds": -5}},
        {"metadata": _meta("less"), "spec": {"minMember": -3}},
    ),
}
