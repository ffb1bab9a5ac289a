"""Measures what placement is worth to a teleoperated robot: EO2, as docs/evaluation/eo2-protocol.md registered it.

Deploys examples/reference/teleop-ros{1,2} again and again on four real nodes: under kube-scheduler, kube-scheduler with hand-written
affinity, and ours, in a random order that --seed gives. Every deployment is written to the file of --json as it ends. A session starts its
cluster once; --resume goes on with the file of an earlier one. The report is printed when all deployments are there, or with --analyse.
Needs root.
"""

import argparse
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NoReturn

from campaigns.common import options
from campaigns.common.output import say
from campaigns.teleop import analysis, plot, records
from campaigns.teleop.cluster import Site, run_site
from campaigns.teleop.deployments import Attempt
from campaigns.teleop.design import ROUNDS, SEED, Turn, plan_turns
from campaigns.teleop.machine import FREE_SHARE, describe_machine, measure_load
from campaigns.teleop.records import Deployment, Header, Journal, RecordError, Session
from robotapp_testbed.binaries.pins import REPOSITORY
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real import UnavailableError, prerequisites

LONGEST_S: Final = 75.0
"""No deployment begins when less of the budget is left."""
USUAL_S: Final = 20.0
PILOT_SEED: Final = 1
MOST_VOID: Final = 3
"""Void deployments of one turn, after which the rig is not fit."""


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _make_parser().parse_args(argv)
    try:
        header = choose_header(arguments.seed, pilot=arguments.pilot)
        if arguments.analyse:
            _conclude(records.read_file(arguments.json), arguments.plot)
            return 0
        prerequisites.require()
        journal = Journal.open(arguments.json, header, resume=arguments.resume)
        _begin_session(journal, may_be_loaded=arguments.loaded)
    except (RecordError, UnavailableError) as problem:
        print(problem, file=sys.stderr)
        return 1
    signal.signal(signal.SIGTERM, _interrupt)  # a time limit ends the cluster as ^C does
    limits = Limits(arguments.deployments, time.monotonic() + 60 * arguments.budget_minutes)
    try:
        run(journal, limits)
    except KeyboardInterrupt:
        say("interrupted; go on with --resume")
    except (TestbedError, OSError) as problem:
        say(f"{problem}; go on with --resume")
        return 1
    pending = journal.results.list_pending(plan_turns(header.seed, header.rounds))
    if pending and not header.pilot:
        say(f"{len(pending)} deployments are to be made; go on with --resume")
        return 0
    _conclude(journal.results, arguments.plot)
    return 0


def choose_header(seed: int | None, *, pilot: bool) -> Header:
    """Returns the header of a new file. A pilot never has the seed of the run that counts."""
    if pilot and seed == SEED:
        raise RecordError(f"the seed {SEED} is that of the run that counts: give a pilot another one")
    return Header(seed=(PILOT_SEED if pilot else SEED) if seed is None else seed, rounds=ROUNDS, pilot=pilot)


@dataclass
class Limits:
    """Ends of a session, besides its last turn."""

    deployments: int
    until_s: float
    """By the monotonic clock."""

    def allow(self, count: int) -> bool:
        return count < self.deployments and time.monotonic() + LONGEST_S < self.until_s


def run(journal: Journal, limits: Limits) -> None:
    """Makes the pending deployments in their order, as far as the limits allow."""
    turns = plan_turns(journal.results.header.seed, journal.results.header.rounds)
    pending = journal.results.list_pending(turns)
    if not pending:
        say("all deployments are there")
        return
    began_s = time.monotonic()
    with run_site() as site:
        say(
            f"the nodes are ready after {time.monotonic() - began_s:.0f} s; {len(pending)} of {len(turns)} deployments to be made"
        )
        count = 0
        while pending and limits.allow(count):
            began_s = time.monotonic()
            deployment = deploy(site, pending[0], journal)
            count += 1
            pending = journal.results.list_pending(turns)
            took_s = time.monotonic() - began_s
            say(
                f"{describe(deployment)} [{took_s:.0f} s, {len(pending)} to go, about {len(pending) * USUAL_S / 60:.0f} min]"
            )


def deploy(site: Site, turn: Turn, journal: Journal) -> Deployment:
    """Makes and records one deployment, which is void when it is interrupted."""
    if journal.results.count_void(turn) >= MOST_VOID:
        raise TestbedError(f"deployment {turn.number} was void {MOST_VOID} times: mend the rig first")
    session = len(journal.results.sessions)
    try:
        site.set_condition(turn.condition)
        deployment = Attempt(site, turn, session=session).run()
    except (KeyboardInterrupt, TestbedError, OSError) as problem:
        reason = str(problem) or "the runner was interrupted"
        journal.append(Deployment(turn, session, _tell_time(), void=reason))
        raise
    journal.append(deployment)
    return deployment


def describe(deployment: Deployment) -> str:
    """Returns a line about a deployment for the screen."""
    turn, figures = deployment.turn, deployment.figures
    name = f"{turn.number} (block {turn.block}) ROS {turn.condition.ros}, {turn.condition.disturbance}, {turn.arm}"
    if deployment.void:
        return f"{name}: void, {deployment.void}"
    if figures is None or not figures.sent:
        return f"{name}: no round trip; operator side on {deployment.node or 'no node'}"
    busy = f", machine {deployment.load.busy_share:.0%} busy" if deployment.load else ""
    return (
        f"{name} on {deployment.node}: p50 {figures.p50_ms:.1f}, p95 {figures.p95_ms:.1f}, p99 {figures.p99_ms:.1f} ms,"
        f" missed {figures.missed_share:.1%}, first trip {figures.first_trip_s:.1f} s{busy}"
    )


def _begin_session(journal: Journal, *, may_be_loaded: bool) -> None:
    load = measure_load()
    is_loaded = load.busy_share > FREE_SHARE
    if is_loaded and not may_be_loaded:
        raise RecordError(
            f"others use {load.busy_share:.0%} of the machine's CPU time, at most {FREE_SHARE:.0%} are allowed: wait, or mark the"
            " results with --loaded"
        )
    machine = describe_machine()
    journal.append(Session(_tell_time(), _read_commit(), machine, loaded=is_loaded, load_average=load.average))


def _conclude(results: records.Results, picture: Path | None) -> None:
    print("\n".join(analysis.report(results)))
    if picture:
        picture.write_text(plot.draw(results))


def _tell_time() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _read_commit() -> str:
    command = ["git", "-C", str(REPOSITORY), "describe", "--always", "--dirty", "--abbrev=12"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def _interrupt(number: int, _frame: object) -> NoReturn:
    raise KeyboardInterrupt(f"ended by {signal.Signals(number).name}")


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench teleop", description=__doc__)
    parser.add_argument(
        "--json", type=options.report, required=True, metavar="FILE", help="file of results, a line of JSON each"
    )
    parser.add_argument("--plot", type=options.report, metavar="FILE", help="box plots of the deployments, as SVG")
    parser.add_argument("--resume", action="store_true", help="go on with the file of an earlier session")
    parser.add_argument("--analyse", action="store_true", help="report what the file has, without a cluster")
    parser.add_argument("--deployments", type=options.count(1), default=10**6, metavar="N", help="end after so many")
    parser.add_argument(
        "--budget-minutes", type=options.amount, default=10**6, metavar="M", help="end within this time"
    )
    parser.add_argument("--seed", type=int, help=f"of the order ({SEED}; of a pilot {PILOT_SEED})")
    parser.add_argument("--pilot", action="store_true", help="mark the file as one that counts for nothing")
    parser.add_argument(
        "--loaded", action="store_true", help="start although others use the machine, and mark the results"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
