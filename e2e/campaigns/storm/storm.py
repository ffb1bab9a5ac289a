"""A storm of claims: far more wishes than domains and devices, deaths and forgeries, judged at every revision of the store.

Nodes and kubelets are simulated; two operators, two schedulers and the API server are real. The programs lose answers to
writes that were done. With `--weakened RULE…` they break a rule of the claims: one storm for each rule, over at the first
state that shows it, and what is printed is the number of grants until then.
"""

import argparse
import json
import logging
import sys
from collections.abc import Sequence

from campaigns.claims.claims_weakened import ALL
from campaigns.common import options
from campaigns.storm.campaign import Plan, Report, Storm
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product

VALUES = {"domainPool": {"ids": "1-101", "quarantineSeconds": 1}}
EVENT_TTL = {"kube-apiserver": ["--event-ttl=10m"]}
"""Hours of a storm would fill etcd with them."""
GO = {program: {"GOGC": "400"} for program in ("etcd", "kube-apiserver", "kube-controller-manager", "kwok")}
"""They hold few objects and make many: with Go's default they would collect garbage all the time."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench storm", description=__doc__)
    parser.add_argument("--grants", type=options.count(1, 10_000_000), default=20_000)
    parser.add_argument("--wanted", type=options.count(10, 5000), default=500, help="apps and pods at a time")
    parser.add_argument("--robots", type=options.count(1, 100), default=10, help="robots with five devices each")
    parser.add_argument("--every", type=options.count(1), default=200, help="grants between two blows to a program")
    parser.add_argument(
        "--lose", type=options.amount, default=0.01, help="share of the answers to writes that get lost"
    )
    parser.add_argument("--full-churn", action="store_true", help="a tenth goes each second, even if few were granted")
    parser.add_argument(
        "--weakened",
        choices=sorted(ALL),
        nargs="*",
        default=None,
        help="rules that the programs break; all without a name",
    )
    parser.add_argument("--most-minutes", type=options.count(1), default=1440, help="end the storm after so long")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", stream=sys.stderr)
    with ControlPlane(node_lease_s=400, extra_args=EVENT_TTL, environment=GO) as cp:
        product.install(cp, values=VALUES)
        if arguments.weakened is not None:
            return _weakened(cp, arguments)
        report = Storm(cp, _plan(arguments)).run(arguments.grants)
    print(json.dumps(_figures(report), indent=2))
    return 1 if report.problems else 0


def _plan(arguments: argparse.Namespace, weakened: str = "") -> Plan:
    return Plan(
        wanted=arguments.wanted,
        robots=arguments.robots,
        every=arguments.every,
        lose=arguments.lose,
        seed=arguments.seed,
        weakened=weakened,
        full_churn=arguments.full_churn,
        most_s=arguments.most_minutes * 60.0,
    )


def _weakened(cp: ControlPlane, arguments: argparse.Namespace) -> int:
    """How many of them were not noticed, as an exit status of 0 or 1. That nothing is granted any more is noticed as well."""
    missed = 0
    for weakened in arguments.weakened or ALL:
        report = Storm(cp, _plan(arguments, weakened)).run(arguments.grants)
        shown = [*report.verdict.broken, report.stalled]
        said = shown[0] or f"not noticed in {report.verdict.grants} grants"
        missed += not shown[0]
        print(f"{weakened}: {said} ({report.seconds:.0f} s)", flush=True)
    return 1 if missed else 0


def _figures(report: Report) -> dict[str, object]:
    return {
        "grants": report.verdict.grants,
        "seconds": round(report.seconds, 1),
        **report.figures,
        "double or without claim": len(report.verdict.broken),
        "lost": len(report.lost),
        "left": len(report.left),
        "problems": report.problems,
    }


if __name__ == "__main__":
    sys.exit(main())
