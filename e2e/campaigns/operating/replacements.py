"""Is there ever a second publisher? Pods of single-replica components are replaced by force, and a watch of its own counts pods.

Pods are deleted, evicted, drained and edited, and nodes fall silent or are deleted and come back, under components with each
`onDisconnect`. Nodes and kubelets are simulated; control plane, operator and scheduler are real. A pod may run from its binding
until its object is gone or its containers have ended. While the node of a component that fails over is lost, two may run: such
overlaps are promised, and counted apart.
"""

import argparse
import json
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict

from campaigns.common import options
from campaigns.operating.replacement_campaign import FORCES, Replacement, Report, run
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench replacements", description=__doc__)
    parser.add_argument("--count", type=options.count(1, 100_000), default=200, help="replacements in all")
    parser.add_argument("--lanes", type=options.count(1, 50), default=12, help="apps that are driven at the same time")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-minutes", type=options.count(1), default=60, help="begin no replacement after so long")
    parser.add_argument("--json", type=options.report, help="write every replacement and overlap to this file")
    arguments = parser.parse_args(argv)
    began_s = time.monotonic()
    with ControlPlane() as cp:
        product.install(cp)
        product.start_scheduler(cp, sweep_seconds=1)
        product.start_operator(cp, sweep_seconds=1, no_leader_election=True)
        with created(cp, "replacements") as namespace:
            report = run(
                cp,
                namespace,
                replacements=arguments.count,
                lanes=arguments.lanes,
                seed=arguments.seed,
                most_s=60.0 * arguments.most_minutes,
                note=_say,
            )
    print("\n".join(table(report)))
    print(f"{report.revisions} revisions watched, {time.monotonic() - began_s:.0f} s")
    if arguments.json:
        arguments.json.write_text(json.dumps(asdict(report), indent=1) + "\n")
    for problem in report.problems:
        print(problem)
    return 1 if report.problems else 0


def table(report: Report) -> list[str]:
    """One line per force, and one for all."""
    lines = [f"{'force':14}{'replaced':>10}{'overlaps':>10}{'promised':>10}{'median s':>10}{'most s':>10}"]
    for force in (*FORCES, ""):
        of = [each for each in report.replacements if force in ("", each.force)]
        if not of:
            continue
        seconds = [each.seconds for each in of]
        within = [(each.app, *each.revisions) for each in of]
        overlaps, promised = (
            sum(any(app == one.app and first <= one.revision <= last for app, first, last in within) for one in found)
            for found in (report.overlaps, report.promised)
        )
        figures = f"{len(of):>10}{overlaps:>10}{promised:>10}{statistics.median(seconds):>10.1f}{max(seconds):>10.1f}"
        lines.append(f"{force or 'all':14}{figures}")
    return lines


def _say(found: Replacement) -> None:
    kind = f"{'/'.join(found.kind.runs_on)} {found.kind.on_disconnect or 'default'}"
    print(f"{found.app:8} {kind:22} {found.force:12} {found.seconds:5.1f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
