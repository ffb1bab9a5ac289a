"""Edges within budget under our scheduler and kube-scheduler on random topologies: scripts/bench divergence

Each topology has 3 to 40 nodes in up to six zones, every round trip measured, nodes partly taken, and an app of 2 to 12
components whose edges have budgets. It is placed by our scheduler (the joint planner with the scheduler's own problem builder),
by kube-scheduler's rules, and by these with pod affinity to the zone of the peers. HiGHS proves whether any placement
meets all budgets; where one does, ours must, and that is the end with 0. No control plane is started.
"""

import argparse
import json
import platform
import sys
from collections import Counter
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from campaigns.common import options
from campaigns.divergence.campaign import Outcome, outcomes, rows
from robotapp_scheduler.shell.planner.planner import IN_WORKER


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="scripts/bench divergence", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--topologies", type=options.count(1), default=200)
    parser.add_argument("--first", type=options.count(0), default=0, metavar="N", help="number of the first topology")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="write every outcome to this file")
    arguments = parser.parse_args(argv)
    found: list[Outcome] = []
    for outcome in outcomes(arguments.seed, range(arguments.first, arguments.first + arguments.topologies)):
        found.append(outcome)
        if outcome.missed:
            print(f"topology {outcome.number}: {outcome.missed}: {outcome}", file=sys.stderr, flush=True)
    proofs = dict(Counter(str(each.proof) for each in found))
    Console(width=120).print(table(found))
    print(f"HiGHS: {proofs}; planner's limit: {1000 * IN_WORKER.seconds:.0f} ms of CPU")
    if arguments.json:
        given = {"topologies": arguments.topologies, "first": arguments.first, "seed": arguments.seed}
        report = {
            **given,
            "python": platform.python_version(),
            "proofs": proofs,
            "rows": [row._asdict() for row in rows(found)],
            "outcomes": [
                {**each._asdict(), "placed": {name: placed._asdict() for name, placed in each.placed.items()}}
                for each in found
            ],
        }
        arguments.json.write_text(json.dumps(report, indent=1))
    return 1 if any(each.missed for each in found) else 0


def table(found: Sequence[Outcome]) -> Table:
    """One line per scheduler."""
    result = Table(title=f"{len(found)} topologies, {sum(each.edges for each in found)} edges")
    result.add_column("scheduler")
    for title in (
        "edges in budget, where HiGHS meets all",
        "apps with all budgets met, of these",
        "edges in budget, all topologies",
        "edges that run over budget",
    ):
        result.add_column(title, justify="right")
    for row in rows(found):
        result.add_row(row.scheduler, *(f"{value:.1f} %" for value in row[1:]))
    return result


if __name__ == "__main__":
    sys.exit(main())
