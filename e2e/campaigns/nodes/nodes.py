"""Real nodes: times of up and down, what they leave on the machine, also when the owner is killed, and apps that run for long.

`scripts/bench nodes --long` makes 20 lives and 20 kills at random moments, then runs three apps with two pods each on four nodes for ten
minutes (about 19 in all); without it there are 3 lives and 3 kills, as in scripts/test --all, and no long run.
"""

import argparse
import os
import random
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.nodes import machine_census, real_pods, stability
from campaigns.nodes.real_pods import pod
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.real import RealNodes, UnavailableError, parts, prerequisites

UP_S, DOWN_S = 15.0, 5.0
"""What a cluster of four may take on two idle cores."""
_FOLDER_S = 60.0
_OWNER = """
import sys, time
from robotapp_testbed.real import RealNodes
print("begins", flush=True)
with RealNodes(sys.argv[1].split(","), delays={}) as cp:
    print(cp.run_dir, flush=True)
    time.sleep(120)
"""


@dataclass(frozen=True, slots=True)
class Life:
    up_s: float
    down_s: float
    left: dict[str, list[str]] = field(default_factory=dict)
    """By kind, what was not there before."""


@dataclass(frozen=True, slots=True)
class Kill:
    after_s: float
    was_up: bool
    left: dict[str, list[str]]
    next_up_s: float


def live(names: Sequence[str]) -> Life:
    """Start a cluster, run a pod on every node, end it, count."""
    before = machine_census.take()
    begun_s = time.monotonic()
    plane = RealNodes(names, delays={}).start()
    try:
        up_s = time.monotonic() - begun_s
        run_dir = plane.run_dir
        real_pods.run(plane, "default", *(pod(f"on-{name}", name) for name in names))
    finally:
        begun_s = time.monotonic()
        plane.close()
        down_s = time.monotonic() - begun_s
    plane.close()  # once more is no harm
    return Life(up_s, down_s, _left(before, run_dir))


def kill(names: Sequence[str], after_s: float) -> Kill:
    """Start a cluster in a process of its own, kill that after a while, count, and start the next one."""
    before = machine_census.take()
    command = [sys.executable, "-c", _OWNER, ",".join(names)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        owner.stdout.readline()
        time.sleep(after_s)
        os.kill(owner.pid, signal.SIGKILL)
        told = owner.stdout.readline().strip()
    left = _left(before, Path(told) if told else None)
    begun_s = time.monotonic()
    with RealNodes(names[:1]) as plane:
        assert plane.ready_nodes() == set(names[:1])
        next_up_s = time.monotonic() - begun_s
    return Kill(after_s, bool(told), left, next_up_s)


def _left(before: machine_census.Census, run_dir: Path | None) -> dict[str, list[str]]:
    left = machine_census.left_since(before)
    if run_dir and not wait_until(lambda: not run_dir.exists(), timeout_s=_FOLDER_S):
        left["files"] = [str(run_dir)]
    return left


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        say(str(problem))
        return 1
    parts.prepare()  # or the first life would be as long as the compilers take
    names = [f"node-{number}" for number in range(1, arguments.nodes + 1)]
    found = Found()
    for number in range(1, _several(arguments.lives, arguments.long) + 1):
        found.lives.append(live(names))
        say(f"life {number}: {told_of_life(found.lives[-1])}")
        found.save(arguments.json)
    moments = random.Random(arguments.seed)
    usual_s = statistics.median([each.up_s for each in found.lives] or [UP_S / 2])
    for number in range(1, _several(arguments.kills, arguments.long) + 1):
        found.kills.append(kill(names, moments.uniform(0, 2 * usual_s)))  # half of them while it starts
        say(f"kill {number}: {told(found.kills[-1])}")
        found.save(arguments.json)
    minutes = stability.MINUTES * arguments.long if arguments.stable_minutes is None else arguments.stable_minutes
    if minutes:
        found.stable = stable(minutes * 60)
        found.save(arguments.json)
    say(summary(found.lives, found.kills))
    problems = [*verdict(found.lives, found.kills), *(found.stable.problems if found.stable else [])]
    for problem in problems:
        say(problem)
    return 1 if problems else 0


@dataclass
class Found:
    """What is known so far: a run that is interrupted after a quarter of an hour has told it."""

    lives: list[Life] = field(default_factory=list)
    kills: list[Kill] = field(default_factory=list)
    stable: stability.Stable | None = None

    def save(self, path: Path | None) -> None:
        save(path, asdict(self))


def stable(seconds: float) -> stability.Stable:
    """Three apps, placed on four nodes by our scheduler, with operator, scheduler and agents as pods."""
    images = ("tools", "ros2", *components_as_pods.IMAGES)
    with RealNodes(stability.NODES, delays=stability.ONE_WAY_MS, images=images) as cp:
        components_as_pods.run(cp)
        components_as_pods.wait_measured(cp)
        return stability.run(cp, seconds=seconds, say=say)


def _several(wanted: int | None, long: bool) -> int:
    return wanted if wanted is not None else 20 if long else 3


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
    early = sum(not each.was_up for each in kills)
    times = f": {_most('up', [each.up_s for each in lives])}, {_most('down', [each.down_s for each in lives])}"
    return f"{len(lives)} lives{times if lives else ''}; {len(kills)} kills, {early} of them during the start"


def _most(name: str, times_s: Sequence[float]) -> str:
    return f"{name} {statistics.median(times_s):.1f} s (most {max(times_s):.1f})" if times_s else ""


def told_of_life(each: Life) -> str:
    return f"up {each.up_s:.1f} s, down {each.down_s:.1f} s, left {each.left or 'nothing'}"


def told(each: Kill) -> str:
    state = "up" if each.was_up else "starting"
    return f"after {each.after_s:.2f} s while {state}, left {each.left or 'nothing'}, next up {each.next_up_s:.1f} s"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench nodes", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--long", action="store_true", help="20 lives and 20 kills instead of 3, then ten minutes of apps"
    )
    parser.add_argument("--nodes", type=options.count(1, 20), default=4, help="in every cluster of a life or kill")
    parser.add_argument("--lives", type=options.count(0), metavar="N", help="instead of 3 or 20")
    parser.add_argument("--kills", type=options.count(0), metavar="N", help="instead of 3 or 20")
    parser.add_argument(
        "--stable-minutes",
        type=options.amount,
        metavar="M",
        help="of three apps on four nodes, instead of 0 or 10; 0 leaves them out",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the moments of the kills")
    parser.add_argument("--json", type=options.report, help="write every life, kill and app to this file, as they end")
    return parser


if __name__ == "__main__":
    sys.exit(main())
