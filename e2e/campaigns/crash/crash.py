"""Crash safety: operator and scheduler killed -9 at every write of a 20-app workload.

`scripts/bench crash --all` runs every point; `--points N --seed S` a sample, as scripts/test does with 15.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from campaigns.crash.campaign import CrashCampaign, Outcome, kill_points, lives, sample
from robotapp_testbed import ControlPlane

LEAST_OF_ALL = 120
"""Kills a whole campaign must have struck to count."""


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    with ControlPlane() as cp, CrashCampaign(cp, apps=arguments.apps) as campaign:
        writes = campaign.reference()
        points = list(kill_points(writes))
        chosen = points if arguments.all else sample(points, arguments.points, arguments.seed)
        planned = lives(chosen, arguments.kills)
        say(f"writes of one life of {arguments.apps} apps: {writes}; {len(chosen)} of {len(points)} kill points")
        outcomes = []
        for number, each in enumerate(planned, 1):
            outcomes.append(campaign.live(each))
            say(f"life {number}/{len(planned)}: {_line(outcomes[-1])}")
    if arguments.json:
        found = {"writes": writes, "outcomes": [asdict(each) for each in outcomes]}
        arguments.json.write_text(json.dumps(found, indent=1) + "\n")
    failed = sum(bool(each.problems) for each in outcomes)
    struck = _struck(outcomes)
    say(
        f"{struck} kills struck in {len(outcomes)} lives, {len(chosen) - struck} not reached, {failed} lives with problems"
    )
    return exit_code(outcomes, least=LEAST_OF_ALL if arguments.all else 1)


def exit_code(outcomes: Sequence[Outcome], *, least: int) -> int:
    """0 when no life showed a problem and at least `least` kills struck: one that struck nothing has shown nothing."""
    return 1 if any(each.problems for each in outcomes) or _struck(outcomes) < least else 0


def _struck(outcomes: Sequence[Outcome]) -> int:
    return sum(len(each.points) - len(each.missed) for each in outcomes)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench crash", description=__doc__.splitlines()[0])
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument("--all", action="store_true", help="every write, before and after")
    amount.add_argument("--points", type=int, default=15, help="this many, spread over all")
    parser.add_argument("--seed", type=int, default=0, help="rotates the sample")
    parser.add_argument("--kills", type=int, default=12, help="kills within one life of the workload")
    parser.add_argument("--apps", type=int, default=20)
    parser.add_argument("--json", type=Path, help="write every outcome to this file")
    return parser


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def _line(outcome: Outcome) -> str:
    verdict = "; ".join(outcome.problems)
    if verdict:
        verdict += f" (kills: {', '.join(map(str, outcome.points))})"
    struck = len(outcome.points) - len(outcome.missed)
    return f"{struck} kills, ready {outcome.ready_s:.1f} s, gone {outcome.gone_s:.1f} s, {verdict or 'ok'}"


if __name__ == "__main__":
    sys.exit(main())
