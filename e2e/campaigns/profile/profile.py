"""Profile: how often the package analyser is right on labelled public packages (accuracy, hardware, calibration).

    scripts/bench profile --labels FILE.jsonl --checkouts DIR --json FILE

`DIR` holds a folder `<owner>+<repo>` per repository, at the commit of the label. Exit 0 only when the targets are met.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaigns.profile.profile_figures import CLASSES, Case, figures, folds, misses, report
from ros_profile.decide.profiling import profile
from ros_profile.files.load import Workspace, load
from ros_profile.generate import engine_named
from ros_profile.model.conclusions import Assessment, PackageProfile

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


def labels(file: Path) -> list[Label]:
    found = []
    for number, line in enumerate(file.read_text().splitlines(), start=1):
        if not line.strip():
            continue
        row = json.loads(line)
        missing = {"id", "repo", "path", "qos_class", "hardware"} - row.keys()
        if missing or row["qos_class"] not in CLASSES:
            sys.exit(f"{file}:{number}: needs id, repo, path, hardware and a qos_class of {', '.join(CLASSES)}")
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
    cases, spent = measured(labels(options.labels), options.checkouts)
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
    if options.json:
        options.json.write_text(json.dumps(result, indent=2, sort_keys=True) + "\n")
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
    parser.add_argument("--json", type=Path, help="where the figures go")
    parser.add_argument("--misses", action="store_true", help="print what was judged wrong")
    return parser


if __name__ == "__main__":
    sys.exit(main())
