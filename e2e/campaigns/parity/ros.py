"""Pods without ROS fields: ours with all ROS plugins against ours with kube-scheduler's plugins alone, without a cluster."""

import time
from collections.abc import Callable

from campaigns.cluster_cases import FAMILIES, seeded_case
from campaigns.parity.report import Report
from campaigns.parity.ros_surroundings import both, decided
from campaigns.parity.verdict import Verdict


def campaign(*, cases: int, seed: str, say: Callable[[str], None]) -> Report:
    """Each case in a cluster of robots; what differs between the two decisions, whole."""
    report = Report(seed)
    started = time.monotonic()
    for number in range(cases):
        case = seeded_case(seed, number=number, families=list(FAMILIES))
        with_ros, without = (decided(core, case) for core in both(case))
        scored = {name: {"total": found} for name, found in without["nodes"].items() if isinstance(found, int)}
        report.take(case, Verdict(without["node"] or "", without["message"], scored if without["total"] else {}))
        if unequal := [f"{key}: {with_ros[key]} with, {value} without" for key, value in without.items()
                       if with_ros[key] != value]:  # fmt: skip
            names = {"number": number, "families": case.families}
            report.differs(case, {**names, "differences": unequal, "objects": case.objects})
        if number % 500 == 499:
            say(f"{number + 1}/{cases} cases, {len(report.found)} differences")
    report.seconds = time.monotonic() - started
    return report
