"""Profile: how often the package analyser is right on labelled public packages (accuracy, hardware, calibration).

    scripts/bench profile --labels FILE.jsonl --checkouts DIR --json FILE [--half unseen]

`--half` measures the labels whose `half` is this one: `mended`, which rules were mended with, or `unseen`, which they never
were. `DIR` holds a folder `<owner>+<repo>` per repository, at the commit of the label. Exit 0 only when the targets are met.
"""

import argparse
import json
import math
import sys
import time
import zlib
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaigns.common.output import save
from ros_profile.decide.profiling import profile
from ros_profile.files.load import Workspace, load
from ros_profile.generate import engine_named
from ros_profile.model.conclusions import Assessment, PackageProfile

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
        "hardware_bearing": len(bearing),
        "intervals": {
            "qos": interval([c.class_right for c in cases]),
            "hardware_exact": interval([c.hardware_right for c in cases]),
            "hardware_bearing_exact": interval([c.hardware_right for c in bearing]),
        },
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


def interval(right: Sequence[bool]) -> tuple[float, float]:
    """Returns the 95 % interval of a share, after Wilson."""
    count = len(right)
    if not count:
        return 0.0, 1.0
    share, z = sum(right) / count, 1.96
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return round(max(0.0, middle - half), 4), round(min(1.0, middle + half), 4)


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
    shares = "; ".join(f"{key} {low:.0%} to {high:.0%}" for key, (low, high) in found["intervals"].items())
    lines.append(f"95 % intervals (Wilson): {shares}, of {found['hardware_bearing']} with hardware")
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


VARIANTS = (("rules", True), ("rules", False), ("thesis", False))


@dataclass(frozen=True)
class Label:
    id: str
    repo: str
    path: str
    qos_class: str
    hardware: tuple[str, ...]
    placement: str
    confidence: str


def labels(file: Path, half: str = "") -> list[Label]:
    """Returns the labels of a file, or those of one half of it."""
    found = []
    for number, line in enumerate(file.read_text().splitlines(), start=1):
        if not line.strip():
            continue
        row = json.loads(line)
        missing = {"id", "repo", "path", "qos_class", "hardware"} - row.keys()
        if missing or row["qos_class"] not in CLASSES:
            sys.exit(f"{file}:{number}: needs id, repo, path, hardware and a qos_class of {', '.join(CLASSES)}")
        if half and row.get("half") != half:
            continue
        hardware = tuple(sorted(row["hardware"]))
        found.append(
            Label(
                row["id"],
                row["repo"],
                row["path"],
                row["qos_class"],
                hardware,
                row.get("placement", ""),
                row.get("confidence", ""),
            )
        )
    return found


def measured(wanted: list[Label], checkouts: Path) -> tuple[dict[str, list[Case]], float]:
    """Cases by variant, and the seconds of processor time for reading and judging with rules alone."""
    found: dict[str, list[Case]] = {_name(*variant): [] for variant in VARIANTS}
    spent = 0.0
    for repo in sorted({label.repo for label in wanted}):
        folder = checkouts / repo.replace("/", "+")
        here = [label for label in wanted if label.repo == repo]
        if not folder.is_dir():
            for cases in found.values():
                cases += [_case(label, None) for label in here]
            continue
        begun = time.process_time()
        workspace, alone = _loaded(folder, here)
        for engine, curated in VARIANTS:
            by_path = _judged(workspace, engine, curated=curated) | {
                path: package
                for path, one in alone.items()
                for package in _judged(one, engine, curated=curated).values()
            }
            found[_name(engine, curated)] += [_case(label, by_path.get(label.path)) for label in here]
            if (engine, curated) == VARIANTS[0]:
                spent += time.process_time() - begun
    return found, spent


def _loaded(folder: Path, wanted: list[Label]) -> tuple[Workspace, dict[str, Workspace]]:
    """The repository, and by path each labelled package in it that a marker such as CATKIN_IGNORE hides."""
    workspace = load(folder)
    seen = {package.path for package in workspace.packages}
    hidden = [label.path for label in wanted if label.path not in seen and (folder / label.path).is_dir()]
    return workspace, {path: load(folder / path) for path in hidden}


def _judged(workspace: Workspace, engine: str, *, curated: bool) -> dict[str, PackageProfile]:
    judged = profile(
        workspace.packages, engine_named(engine, workspace.packages, curated=curated), path="", curated=curated
    )
    return {package.path: package for package in judged.packages}


def _name(engine: str, curated: bool) -> str:
    return engine if engine == "thesis" else f"rules {'with' if curated else 'without'} table"


def _case(label: Label, package: PackageProfile | None) -> Case:
    assessment = package.assessment if package else Assessment(None)
    qos = assessment.qos_class
    return Case(
        id=label.id,
        repo=label.repo,
        label_confidence=label.confidence,
        want_class=label.qos_class,
        got_class=qos.value.value if qos else "",
        class_confidence=qos.confidence if qos else 0.0,
        want_hardware=label.hardware,
        got_hardware=tuple(sorted(e.value.type for e in assessment.hardware)),
        hardware_confidence=assessment.hardware_confidence,
        want_placement=label.placement,
        got_placement=assessment.placement.value.value if assessment.placement else "",
        found=package is not None,
        reason=qos.reason if qos else "",
    )


def main(arguments: Iterable[str] | None = None) -> int:
    options = _options().parse_args(list(arguments) if arguments is not None else None)
    cases, spent = measured(labels(options.labels, options.half), options.checkouts)
    result: dict[str, Any] = {"cpu_s": round(spent, 2), "variants": {}}
    for name, found in cases.items():
        result["variants"][name] = figures(found) | {"folds": folds(found)}
        print(report(name, result["variants"][name]))
        if options.misses and name != "thesis":
            print(misses(found))
    with_table, without = result["variants"]["rules with table"], result["variants"]["rules without table"]
    lost = {
        key: round(with_table[key] - without[key], 4) for key in ("qos", "hardware_exact", "hardware_bearing_exact")
    }
    result["lost_without_table"] = lost
    result["failed"] = with_table["failed"] + [
        f"{key} falls by {v:.1%} without the table" for key, v in lost.items() if v > 0.05
    ]
    save(options.json, result)
    print(f"processor time {spent:.1f} s for {len(cases['thesis'])} labels with all packages beside them")
    print("targets met" if not result["failed"] else "targets missed: " + "; ".join(result["failed"]))
    return 1 if result["failed"] else 0


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/bench profile", description=__doc__.splitlines()[0] if __doc__ else ""
    )
    parser.add_argument(
        "--labels", type=Path, required=True, help="one JSON object per line: id, repo, path, qos_class, hardware"
    )
    parser.add_argument(
        "--checkouts", type=Path, required=True, help="folder with a folder <owner>+<repo> per repository"
    )
    parser.add_argument("--half", choices=("mended", "unseen"), default="", help="measure only labels of this half")
    parser.add_argument("--json", type=Path, help="where the figures go")
    parser.add_argument("--misses", action="store_true", help="print what was judged wrong")
    return parser


if __name__ == "__main__":
    sys.exit(main())
