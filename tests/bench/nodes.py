"""Real nodes: times of up and down, and what they leave on the machine, also when the owner is killed.

`scripts/bench nodes --long` makes 20 lives and 20 kills at random moments; without it there are 3 of each, as in scripts/test.
"""

import argparse
import json
import random
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tests.support.nodes_campaign import DOWN_S, UP_S, Kill, Life, kill, live

from robotapp_testbed.real import UnavailableError, prerequisites


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        say(str(problem))
        return 1
    names = [f"node-{number}" for number in range(1, arguments.nodes + 1)]
    moments = random.Random(arguments.seed)
    lives: list[Life] = []
    kills: list[Kill] = []
    for number in range(arguments.lives or (20 if arguments.long else 3)):
        lives.append(live(names))
        say(
            f"life {number + 1}: up {lives[-1].up_s:.1f} s, down {lives[-1].down_s:.1f} s, left {lives[-1].left or 'nothing'}"
        )
    usual_s = statistics.median(each.up_s for each in lives)
    for number in range(arguments.kills or (20 if arguments.long else 3)):
        kills.append(kill(names, moments.uniform(0, 2 * usual_s)))  # half of them while it starts
        say(f"kill {number + 1}: {told(kills[-1])}")
    if arguments.json:
        found = {"lives": [asdict(each) for each in lives], "kills": [asdict(each) for each in kills]}
        arguments.json.write_text(json.dumps(found, indent=1) + "\n")
    problems = verdict(lives, kills)
    say(summary(lives, kills))
    for problem in problems:
        say(problem)
    return 1 if problems else 0


def verdict(lives: Sequence[Life], kills: Sequence[Kill]) -> list[str]:
    """What falls short, in sentences."""
    problems = [f"life {number}: {each.left} stayed" for number, each in enumerate(lives, 1) if each.left]
    problems += [f"kill {number}: {each.left} stayed" for number, each in enumerate(kills, 1) if each.left]
    problems += [
        f"life {number}: up took {each.up_s:.1f} s" for number, each in enumerate(lives, 1) if each.up_s > UP_S
    ]
    return problems + [
        f"life {number}: down took {each.down_s:.1f} s" for number, each in enumerate(lives, 1) if each.down_s > DOWN_S
    ]


def summary(lives: Sequence[Life], kills: Sequence[Kill]) -> str:
    up, down = [each.up_s for each in lives], [each.down_s for each in lives]
    early = sum(not each.was_up for each in kills)
    return (
        f"{len(lives)} lives: up {statistics.median(up):.1f} s (most {max(up):.1f}), down {statistics.median(down):.1f} s"
        f" (most {max(down):.1f}); {len(kills)} kills, {early} of them during the start"
    )


def told(each: Kill) -> str:
    state = "up" if each.was_up else "starting"
    return f"after {each.after_s:.2f} s while {state}, left {each.left or 'nothing'}, next up {each.next_up_s:.1f} s"


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench nodes", description=__doc__.splitlines()[0])
    parser.add_argument("--long", action="store_true", help="20 lives and 20 kills instead of 3")
    parser.add_argument("--nodes", type=int, default=4, help="in every cluster")
    parser.add_argument("--lives", type=int, default=0, metavar="N", help="instead of 3 or 20")
    parser.add_argument("--kills", type=int, default=0, metavar="N", help="instead of 3 or 20")
    parser.add_argument("--seed", type=int, default=0, help="of the moments of the kills")
    parser.add_argument("--json", type=Path, help="write every life and kill to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
