"""Campaigns without a cluster: the product against the scalar reference, and with ROS plugins against without.

The families take turns at the centre of a case. A case is named by seed and number, so that `--seed S --case N` shows it again.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace

from campaigns.cluster_cases import FAMILIES, Case, seeded_case
from campaigns.cluster_cases.shrinking import shrunk
from campaigns.parity.report import Report
from campaigns.parity.ros_surroundings import both, decided
from campaigns.parity.verdict import Verdict
from campaigns.reference_scheduler.comparison import differences

ATTEMPTS = 1500
"""Cases tried to make one that differs smaller."""
Say = Callable[[str], None]


def compare_with_reference(*, cases: int, seed: str, say: Say) -> Report:
    """Compares the product with `e2e/campaigns/reference_scheduler`; the first case that differs is made small."""

    def compare(report: Report, number: int, case: Case) -> None:
        report.take(case)
        if unequal := judge(case):
            objects = case.objects if report.found else shrink(case).objects
            report.differs(
                case, {"number": number, "families": case.families, "differences": unequal, "objects": objects}
            )

    return _run_cases(compare, cases=cases, seed=seed, say=say)


def compare_without_ros_plugins(*, cases: int, seed: str, say: Say) -> Report:
    """Compares all plugins with kube-scheduler's alone, for pods without ROS fields in a cluster of robots."""

    def compare(report: Report, number: int, case: Case) -> None:
        with_ros, without = (decided(core, case) for core in both(case))
        totals = {name: {"total": total} for name, total in without["nodes"].items() if isinstance(total, int)}
        report.take(case, Verdict(without["node"] or "", without["message"], totals if without["total"] else {}))
        unequal = [
            f"{key}: {with_ros[key]} with, {value} without" for key, value in without.items() if with_ros[key] != value
        ]
        if unequal:
            names = {"number": number, "families": case.families}
            report.differs(case, {**names, "differences": unequal, "objects": case.objects})

    return _run_cases(compare, cases=cases, seed=seed, say=say)


def describe_case(*, seed: str, number: int) -> str:
    """Returns a single case of a campaign with its differences, small if it differs."""
    case = seeded_case(seed, number=number, families=list(FAMILIES))
    if judge(case):
        case = shrink(case)
    lines = [f"families: {', '.join(case.families)}", *(f"- {text}" for text in judge(case) or ["no difference"])]
    return "\n".join([*lines, *(json.dumps(item) for item in case.objects)])


def judge(case: Case) -> list[str]:
    """Returns the differences; a crash of the product is one, and must not end the campaign."""
    try:
        return differences(case)
    except Exception as error:  # noqa: BLE001 - whatever the product raises is the finding
        return [f"{type(error).__name__}: {error}"]


def shrink(case: Case) -> Case:
    """Returns the smallest case found whose first difference is of the same kind: one that lacks what an API server demands
    fails in another way."""
    kind = _kind_of(judge(case))
    objects = shrunk(
        case.objects, lambda items: _kind_of(judge(replace(case, objects=items))) == kind, attempts=ATTEMPTS
    )
    return replace(case, objects=objects)


def _kind_of(unequal: list[str]) -> str:
    return unequal[0].partition(":")[0] if unequal else ""


def _run_cases(compare: Callable[[Report, int, Case], None], *, cases: int, seed: str, say: Say) -> Report:
    report = Report(seed)
    started_s = time.monotonic()
    for number in range(cases):
        compare(report, number, seeded_case(seed, number=number, families=list(FAMILIES)))
        if number % 1000 == 999:
            say(f"{number + 1}/{cases} cases, {len(report.found)} differences")
    report.seconds = time.monotonic() - started_s
    return report
