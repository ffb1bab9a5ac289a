"""What a run of the bench leaves behind, as it goes into the JSON file and comes back from it."""

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from campaigns.common.figures import medians
from campaigns.speed.contestants import BARE, KUBE_SCHEDULER, OURS
from campaigns.speed.verdict import Verdict, judge
from campaigns.speed.workloads import WORKLOADS

Figures = dict[str, float]


@dataclass(slots=True)
class Row:
    """All runs of one workload: by contestant its pods and, per round, its figures."""

    workload: str
    pods: dict[str, int] = field(default_factory=dict)
    runs: dict[str, list[Figures]] = field(default_factory=dict)

    def add(self, contestant: str, pods: int, figures: Figures) -> None:
        self.pods[contestant] = pods
        self.runs.setdefault(contestant, []).append(figures)

    def median(self, contestant: str) -> Figures:
        return medians(self.runs.get(contestant, []))

    def verdict(self) -> Verdict:
        ours, theirs, bare = (self.median(each.name) for each in (OURS, KUBE_SCHEDULER, BARE))
        return judge(WORKLOADS[self.workload].targets, ours, theirs, bare)


@dataclass(slots=True)
class Result:
    """`options` and `machine` say what was measured where, `command` how to do it again."""

    command: str
    options: dict[str, Any]
    machine: dict[str, str]
    rows: list[Row] = field(default_factory=list)

    def write(self, path: Path) -> None:
        document = dataclasses.asdict(self)
        for row, raw in zip(self.rows, document["rows"], strict=True):
            raw["median"] = {name: row.median(name) for name in row.runs}
            raw["verdict"] = dataclasses.asdict(row.verdict())
        path.write_text(json.dumps(_finite(document), indent=1, ensure_ascii=False) + "\n")


def read(path: Path) -> Result:
    raw = json.loads(path.read_text())
    rows = [Row(each["workload"], each["pods"], each["runs"]) for each in raw["rows"]]
    return Result(raw["command"], raw["options"], raw["machine"], rows)


def merged(results: Iterable[Result]) -> list[Row]:
    """Rows of several files in the order of the workloads; a later file replaces an earlier one's row."""
    latest = {row.workload: row for result in results for row in result.rows}
    return [latest[name] for name in WORKLOADS if name in latest]


def _finite(value: Any) -> Any:
    """NaN is no JSON."""
    if isinstance(value, float):
        return None if math.isnan(value) else round(value, 4)
    if isinstance(value, Mapping):
        return {name: _finite(each) for name, each in value.items()}
    return [_finite(each) for each in value] if isinstance(value, list | tuple) else value
