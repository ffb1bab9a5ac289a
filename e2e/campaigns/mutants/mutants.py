"""20 small faults, one at a time in a copy of the tree: which test notices each, and after how long."""

import argparse
import json
import shlex
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from campaigns.common.options import amount, report
from campaigns.mutants.catalogue import FAULTS, Fault, MissingTextError, put_in, select_faults, take_out
from campaigns.mutants.page import Result, render_json, render_page
from campaigns.mutants.stages import Stage, plan_stages
from campaigns.mutants.tree_copy import PytestRun, TreeCopy

ROOT: Final = Path(__file__).resolve().parents[3]
MOST_MINUTES: Final = 180.0
_OUTPUTS: Final = ("--json", "--page")


class Campaign:
    """All faults in turn. `failing` are tests that fail in the copy without any fault: they notice nothing."""

    def __init__(self, copy: TreeCopy, *, rest: bool, budget_s: float) -> None:
        self._copy = copy
        self._rest = rest
        self._ends_s = time.monotonic() + budget_s
        self.failing: set[str] = set()

    def run(self, faults: Sequence[Fault]) -> Iterator[Result]:
        """Tries each fault; what one leaves of its share of the time goes to those after it."""
        for number, fault in enumerate(faults):
            share_s = (self._ends_s - time.monotonic()) / (len(faults) - number)
            print(f"[{number + 1}/{len(faults)}] {fault.name}: {fault.harm} ({fault.file})", flush=True)
            result = self._try_fault(fault, time.monotonic() + share_s)
            print(f"    {describe(result)}", flush=True)
            yield result

    def _try_fault(self, fault: Fault, ends_s: float) -> Result:
        seconds, stage_name = 0.0, ""
        for stage in plan_stages(fault, self._copy.path, rest=self._rest):
            stage_name = stage.name
            answer = self._run_stage(fault, stage, ends_s)
            seconds += answer.seconds
            if answer.failed or not answer.is_over:
                return Result(fault, answer.failed, stage.name, stage.is_daily, seconds, answer.is_over)
        return Result(fault, "", stage_name, is_daily=False, seconds=seconds)

    def _run_stage(self, fault: Fault, stage: Stage, ends_s: float) -> PytestRun:
        """Runs one stage with the fault until a test fails that passes without it."""
        while True:
            print(f"    {stage.name}: {' '.join(stage.tests)}", flush=True)
            options = [*stage.options, *(f"--deselect={test}" for test in sorted(self.failing))]
            text = put_in(fault, self._copy.path)
            try:
                answer = self._copy.run_tests(
                    stage.tests, options=options, variables=stage.environment, most_s=self._left_s(ends_s)
                )
            finally:
                take_out(fault, self._copy.path, text)
            if answer.tail:
                print(answer.tail, flush=True)
            if not answer.failed or answer.tail or self._passes(answer.failed, stage):
                return answer
            print(f"    {answer.failed} fails without the fault as well, so it is left out", flush=True)
            self.failing.add(answer.failed)

    def _passes(self, test: str, stage: Stage) -> bool:
        """Returns whether the test passes without a fault. One that could not be run to its end counts as passed."""
        most_s = self._left_s(self._ends_s)
        return not self._copy.run_tests([test], variables=stage.environment, most_s=most_s).failed

    @staticmethod
    def _left_s(ends_s: float) -> float:
        return max(1.0, ends_s - time.monotonic())


def describe(result: Result) -> str:
    if result.test:
        return f"noticed after {result.seconds:.0f} s by {result.test}"
    end = "" if result.is_over else ", and time ran out before the tests did"
    return f"not noticed in {result.seconds:.0f} s{end}"


def parse_options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/bench mutants", description=__doc__)
    names = [fault.name for fault in FAULTS]
    parser.add_argument("--only", metavar="NAME", action="append", default=[], choices=names, help=", ".join(names))
    parser.add_argument("--rest", action="store_true", help="where scripts/test notices nothing, run all other tests")
    parser.add_argument("--budget-minutes", type=amount, default=MOST_MINUTES, help="for all faults together (180)")
    parser.add_argument("--json", type=report, help="write the results into this file")
    parser.add_argument("--page", type=report, help="write the results as a page in Markdown")
    return parser.parse_args(argv)


def render_command(argv: Sequence[str]) -> str:
    """Returns the command line without the files that it writes."""
    kept, skips = [], False
    for word in argv:
        if not skips and not word.startswith(tuple(f"{option}=" for option in _OUTPUTS)) and word not in _OUTPUTS:
            kept.append(word)
        skips = word in _OUTPUTS
    return shlex.join(["scripts/bench", "mutants", *kept])


def main(argv: Sequence[str] | None = None) -> int:
    """The exit status: 0 when every fault was noticed, 1 when some was not, 2 when they could not be tried."""
    options, command = parse_options(argv), render_command(sys.argv[1:] if argv is None else argv)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    results: list[Result] = []
    with tempfile.TemporaryDirectory(prefix="robotapp-mutants-") as folder:
        try:
            print("copying the newest commit and making its environment", flush=True)
            copy = TreeCopy.create(ROOT, Path(folder) / "tree")
            campaign = Campaign(copy, rest=options.rest, budget_s=60 * options.budget_minutes)
            for result in campaign.run(select_faults(options.only)):
                results.append(result)
                _write(options, results, command=command, commit=copy.commit)
        except (MissingTextError, RuntimeError) as problem:
            sys.stderr.write(f"{problem}\n")
            return 2
    noticed = sum(bool(result.test) for result in results)
    daily = sum(bool(result.test) and result.is_daily for result in results)
    print(f"{noticed} of {len(results)} faults were noticed, {daily} of them by scripts/test")
    return 0 if noticed == len(results) else 1


def _write(options: argparse.Namespace, results: Sequence[Result], *, command: str, commit: str) -> None:
    """Writes what is known after each fault, so that an interrupted run is not lost."""
    if options.json:
        plain = render_json(results, command=command, commit=commit)
        options.json.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")
    if options.page:
        options.page.write_text(render_page(results, command=command, commit=commit), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
