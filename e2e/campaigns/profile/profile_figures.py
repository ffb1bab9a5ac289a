"""Figures of the package analyser on labelled packages: from cases to numbers and text."""

import zlib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

CLASSES = ("realtime", "sensor_data", "system_default", "best_effort")
TARGETS = {"qos": 0.85, "macro_f1": 0.83, "hardware_exact": 0.93, "hardware_bearing_exact": 0.80}
LARGEST_CALIBRATION_ERROR = 0.08
HIGH_CONFIDENCE = 0.8
BINS = 10
FOLDS = 5


@dataclass(frozen=True)
class Case:
    id: str
    repo: str
    label_confidence: str
    want_class: str
    got_class: str
    class_confidence: float
    want_hardware: tuple[str, ...]
    got_hardware: tuple[str, ...]
    hardware_confidence: float
    want_placement: str
    got_placement: str
    found: bool = True
    reason: str = ""

    @property
    def class_right(self) -> bool:
        return self.got_class == self.want_class

    @property
    def hardware_right(self) -> bool:
        return self.got_hardware == self.want_hardware


def figures(cases: Sequence[Case]) -> dict[str, Any]:
    """Everything the report shows; `failed` lists the targets that are missed."""
    per_class = {name: _precision_recall(cases, name) for name in CLASSES}
    bearing = [case for case in cases if case.want_hardware]
    placed = [case for case in cases if case.want_placement]
    worst = [
        c.id
        for c in cases
        if c.want_class == "realtime" and c.got_class == "best_effort" and c.class_confidence >= HIGH_CONFIDENCE
    ]
    table = reliability([(c.class_confidence, c.class_right) for c in cases if c.got_class])
    found: dict[str, Any] = {
        "packages": len(cases),
        "not_found": [case.id for case in cases if not case.found],
        "qos": _share([c.class_right for c in cases]),
        "qos_sure_labels": _share([c.class_right for c in cases if c.label_confidence != "low"]),
        "macro_f1": round(sum(entry["f1"] for entry in per_class.values()) / len(CLASSES), 4),
        "classes": per_class,
        "hardware_exact": _share([c.hardware_right for c in cases]),
        "hardware_bearing_exact": _share([c.hardware_right for c in bearing]),
        "both": _share([c.class_right and c.hardware_right for c in cases]),
        "placement": _share([c.got_placement == c.want_placement for c in placed]),
        "abstained": sum(not c.got_class for c in cases),
        "calibration_error": calibration_error(table),
        "hardware_calibration_error": calibration_error(
            reliability([(c.hardware_confidence, c.hardware_right) for c in cases])
        ),
        "reliability": table,
        "realtime_called_best_effort": worst,
    }
    found["failed"] = _failed(found)
    return found


def _share(right: Sequence[bool]) -> float:
    return round(sum(right) / len(right), 4) if right else 0.0


def _precision_recall(cases: Sequence[Case], name: str) -> dict[str, float]:
    hit = sum(c.got_class == name == c.want_class for c in cases)
    given = sum(c.got_class == name for c in cases)
    wanted = sum(c.want_class == name for c in cases)
    precision, recall = hit / given if given else 0.0, hit / wanted if wanted else 0.0
    f1 = 2 * precision * recall / (precision + recall) if hit else 0.0
    return {"n": wanted, "precision": round(precision, 4), "recall": round(recall, 4), "f1": round(f1, 4)}


def reliability(pairs: Sequence[tuple[float, bool]]) -> list[dict[str, float]]:
    """Per bin of stated confidence: how many, the mean confidence, the share that is right."""
    bins: dict[int, list[tuple[float, bool]]] = defaultdict(list)
    for confidence, right in pairs:
        bins[min(BINS - 1, int(confidence * BINS))].append((confidence, right))
    return [
        {
            "from": index / BINS,
            "n": len(inside),
            "confidence": round(sum(c for c, _ in inside) / len(inside), 4),
            "right": round(sum(right for _, right in inside) / len(inside), 4),
        }
        for index, inside in sorted(bins.items())
    ]


def calibration_error(table: Sequence[dict[str, float]]) -> float:
    """Expected calibration error: the mean distance between stated and seen, weighted by how many."""
    total = sum(row["n"] for row in table)
    return round(sum(row["n"] * abs(row["confidence"] - row["right"]) for row in table) / total, 4) if total else 0.0


def _failed(found: dict[str, Any]) -> list[str]:
    failed = [f"{key} is {found[key]:.3f}, wanted {least:.2f}" for key, least in TARGETS.items() if found[key] < least]
    if found["calibration_error"] > LARGEST_CALIBRATION_ERROR:
        failed.append(f"calibration error is {found['calibration_error']:.3f}, at most {LARGEST_CALIBRATION_ERROR}")
    if found["realtime_called_best_effort"]:
        failed.append(
            "realtime called best_effort with high confidence: " + ", ".join(found["realtime_called_best_effort"])
        )
    return failed


def folds(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """The same packages in FOLDS groups of whole repositories."""
    groups: dict[int, list[Case]] = defaultdict(list)
    for case in cases:
        groups[zlib.crc32(case.repo.encode()) % FOLDS].append(case)
    keys = ("packages", "qos", "macro_f1", "hardware_exact", "hardware_bearing_exact")
    return [{key: figures(inside)[key] for key in keys} for _, inside in sorted(groups.items())]


def report(name: str, found: dict[str, Any]) -> str:
    hardware = (
        f"hardware exact {found['hardware_exact']:.1%}, of packages with hardware {found['hardware_bearing_exact']:.1%}"
    )
    lines = [
        f"== {name}: {found['packages']} packages, {len(found['not_found'])} not found, {found['abstained']} without a class",
        f"QoS {found['qos']:.1%} (macro-F1 {found['macro_f1']:.3f}; without doubtful labels {found['qos_sure_labels']:.1%})",
        f"{hardware}; both right {found['both']:.1%}; placement {found['placement']:.1%}",
    ]
    lines += [
        f"  {key:15} n {entry['n']:3}  precision {entry['precision']:.2f}  recall {entry['recall']:.2f}  F1 {entry['f1']:.2f}"
        for key, entry in found["classes"].items()
    ]
    lines.append(
        f"calibration error {found['calibration_error']:.3f} (hardware {found['hardware_calibration_error']:.3f})"
    )
    lines += [
        f"  stated {row['confidence']:.2f}  right {row['right']:.2f}  n {row['n']}" for row in found["reliability"]
    ]
    lines += [
        f"  fold of {fold['packages']:3}: QoS {fold['qos']:.1%}, hardware exact {fold['hardware_exact']:.1%},"
        f" with hardware {fold['hardware_bearing_exact']:.1%}"
        for fold in found["folds"]
    ]
    return "\n".join(lines)


def misses(cases: Sequence[Case]) -> str:
    lines = [
        f"  {c.id}: {c.got_class or '-'} ({c.class_confidence:.2f}: {c.reason}), labelled {c.want_class}"
        for c in cases
        if not c.class_right
    ]
    lines += [
        f"  {c.id}: {', '.join(c.got_hardware) or 'none'}, labelled {', '.join(c.want_hardware) or 'none'}"
        for c in cases
        if not c.hardware_right
    ]
    return "\n".join(lines)
