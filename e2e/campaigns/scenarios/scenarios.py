"""The thesis' scenarios on random clusters, under our scheduler and kube-scheduler in one control plane.

Each repetition draws a cluster of 3 to --most-nodes nodes with zones, hardware and load, and plays all scenarios in random
order, each under both schedulers with the same draw. Nodes and kubelets are simulated; the control plane, both schedulers and
our operator are real. `--first N --repetitions 1` with the same seed gives repetition N again.
"""

import argparse
import os
import platform
import re
import shlex
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from rich.console import Console

from campaigns.common import options
from campaigns.scenarios.campaign import Campaign, Outcome
from campaigns.scenarios.catalogue import SCENARIOS
from campaigns.scenarios.report import Report, line, section, table
from campaigns.speed.page import replaced
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product

BEGIN, END = "<!-- scenarios: made by scripts/bench scenarios --page -->", "<!-- scenarios: end -->"
WIDTH = 180


def main(argv: Sequence[str] | None = None) -> int:
    parser = _parser()
    arguments = parser.parse_args(argv)
    chosen = [each for each in SCENARIOS.values() if re.search(arguments.only, each.name)]
    if not chosen:
        parser.error(f"no scenario is called so; there are: {', '.join(SCENARIOS)}")
    given = {"repetitions": arguments.repetitions, "first": arguments.first, "seed": arguments.seed,
             "most_nodes": arguments.most_nodes, "only": arguments.only}  # fmt: skip
    machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": str(os.cpu_count())}
    report = Report(_command(sys.argv[1:] if argv is None else argv), given, machine)

    def note(outcome: Outcome) -> None:
        report.outcomes.append(outcome)
        print(line(outcome), file=sys.stderr, flush=True)

    with ControlPlane() as cp:
        product.install(cp)
        try:
            campaign = Campaign(cp, chosen, seed=arguments.seed, most_nodes=arguments.most_nodes)
            campaign.run(range(arguments.first, arguments.first + arguments.repetitions), note)
        finally:
            if arguments.json:
                report.write(arguments.json)
    Console(width=WIDTH).print(table(report))
    if arguments.page:
        arguments.page.write_text(replaced(arguments.page.read_text(), section(report), begin=BEGIN, end=END))
    return 1 if report.missed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/bench scenarios", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.epilog = "scenarios:\n" + "\n".join(f"  {each.name:16}{each.text}" for each in SCENARIOS.values())
    parser.add_argument("--repetitions", type=options.count(1), default=5)
    parser.add_argument("--first", type=options.count(0), default=0, metavar="N", help="number of the first repetition")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-nodes", type=options.count(3, 1000), default=200)
    parser.add_argument("--only", default="", help="scenarios whose name this regular expression finds")
    parser.add_argument("--json", type=options.report, help="write every outcome to this file")
    parser.add_argument("--page", type=Path, help="write the table between the marks of this page: docs/evaluation.md")
    return parser


def _command(given: Sequence[str]) -> str:
    """How to run the same again; where the files went is left out."""
    files = {"--json", "--page"}
    kept = [word for before, word in pairwise(["", *given]) if not {before, word} & files]
    return shlex.join(["scripts/bench", "scenarios", *kept])


if __name__ == "__main__":
    sys.exit(main())
