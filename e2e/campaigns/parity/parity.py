"""Differential: random clusters and pods of all feature families through kube-scheduler and through ours, live.

Compared are the feasible nodes, the FailedScheduling text character by character (on clusters of one node that is the
node's first reason), the weighted score of every plugin, that our choice is among kube-scheduler's best, and who is
evicted for which node, and the ResourceClaims that were written. With --reference ours is compared with the scalar reference instead, without a cluster.
"""

import argparse
import asyncio
import json
import sys
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from campaigns.cluster_cases.regressions import keep
from campaigns.common.output import save, say
from campaigns.parity import live as parity_live
from campaigns.parity import offline
from campaigns.parity.report import Report

Json = dict[str, Any]
SHOWN = 20


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench parity", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, help="3000, with --reference 20000")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--json", type=Path, help="write counts per family and every difference to this file")
    parser.add_argument("--case", type=int, metavar="N", help="this one case of the seed alone")
    parser.add_argument(
        "--family", action="append", help="only cases with such a family at the centre, * for any characters: dra-*"
    )
    parser.add_argument("--shrunk", type=int, default=3, metavar="N", help="make so many differences small (3)")
    parser.add_argument("--keep", action="store_true", help="keep what differs, made small, as regression cases")
    parser.add_argument(
        "--reference", action="store_true", help="against the scalar reference instead, without a cluster"
    )
    parser.add_argument(
        "--ros-plugins",
        action="store_true",
        help="pods without ROS fields, with against without ROS plugins, no cluster",
    )
    arguments = parser.parse_args(argv)
    if arguments.ros_plugins:
        return _with_against_without(arguments)
    return _against_reference(arguments) if arguments.reference else _against_kube_scheduler(arguments)


def _with_against_without(arguments: argparse.Namespace) -> int:
    report = offline.compare_without_ros_plugins(cases=arguments.cases or 1000, seed=arguments.seed, say=say)
    save(arguments.json, report.as_json())
    return _told(report)


def _against_reference(arguments: argparse.Namespace) -> int:
    seed = arguments.seed
    if arguments.case is not None:
        print(offline.describe_case(seed=seed, number=arguments.case))
        return 0
    report = offline.compare_with_reference(cases=arguments.cases or 20_000, seed=seed, say=say)
    save(arguments.json, report.as_json())
    return _told(report)


def _against_kube_scheduler(arguments: argparse.Namespace) -> int:
    seed = arguments.seed
    families = [name for name in parity_live.LIVE if any(fnmatch(name, pattern) for pattern in arguments.family or "*")]
    if not families:
        print(f"no family is called {', '.join(arguments.family)}; there are {', '.join(parity_live.LIVE)}")
        return 2
    cases = parity_live.campaign(seed, arguments.cases or 3000, families)
    if arguments.case is not None:
        cases = iter([parity_live.numbered(seed, arguments.case, families)])
    with parity_live.control_plane() as cp:
        report = asyncio.run(parity_live.run(cp, cases, seed=seed, say=say, shrunk=arguments.shrunk))
    save(arguments.json, report.as_json())
    for each in report.found if arguments.keep else ():
        path = keep(each["objects"], why="; ".join(each["differences"]), profile=each["profile"])
        print(f"kept as {path}")
    for family, why in report.invalid.items():
        print(f"refused by the API server, {family}: {why}")
    return _told(report)


def _told(report: Report) -> int:
    for each in report.found[:SHOWN]:
        print(json.dumps(each))
    print(report.table())
    print(report.summary())
    return 1 if report.found else 0


if __name__ == "__main__":
    sys.exit(main())
