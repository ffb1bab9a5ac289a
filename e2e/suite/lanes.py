"""Runs groups of tests as pytest processes, two at a time, and prints a line as each begins and ends.

The output of a group goes into a file; that of a group with failures is printed whole when it ends.
"""

import itertools
import re
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

from suite.plan import Group
from suite.summary import GroupResult, read_result

LANES: Final = 2
"""Control planes at a time: two cores carry two, and live tests wait for half of their time."""
ON_ALL_CORES: Final = ("--numprocesses=auto", "--maxprocesses=4", "--dist=worksteal")
"""A worker per core, up to four, because every worker imports all packages and collects all tests again."""
REPORT_S: Final = 30.0
"""Seconds between two lines that name what is running."""
NO_TESTS_COLLECTED: Final = 5
"""pytest's exit status when everything in a group was deselected."""


@dataclass
class Lanes:
    """Runs groups and keeps what each came to, in the order in which they ended. `folder` takes reports and outputs."""

    folder: Path
    results: list[GroupResult] = field(default_factory=list)
    reports: list[Path] = field(default_factory=list)
    """The reports of groups that succeeded."""
    _printing: threading.Lock = field(default_factory=threading.Lock)
    _numbers: Iterator[int] = field(default_factory=itertools.count)
    _started: float = field(default_factory=time.monotonic)
    _running: dict[str, tuple[str, float]] = field(default_factory=dict)
    _expected_s: float = 0.0
    _done_s: float = 0.0

    @property
    def succeeded(self) -> bool:
        """Returns True when every group ran to its end without a failure."""
        return all(result.succeeded for result in self.results)

    def run(self, groups: Sequence[Group], environment: Mapping[str, str]) -> None:
        """Runs all groups: those that share the machine first, in two lanes, then the exclusive ones alone.

        `environment` is the user's; the variables of a group are added to it.
        """
        self._started, self._done_s = time.monotonic(), 0.0
        self._expected_s = sum(group.seconds for group in groups)
        side_by_side = [group for group in groups if not group.exclusive and not group.on_all_cores]
        alone = [group for group in groups if group.exclusive or group.on_all_cores]
        stop_event = threading.Event()
        reporter = threading.Thread(target=self._report_running, args=(stop_event,), daemon=True)
        reporter.start()
        try:
            with ThreadPoolExecutor(max_workers=LANES) as executor:
                list(executor.map(lambda group: self._run_group(group, environment), side_by_side))
            for group in alone:
                self._run_group(group, environment)
        finally:
            stop_event.set()
            reporter.join()

    def give_up(self, groups: Sequence[Group]) -> None:
        """Counts groups as not finished, because what they need could not be had."""
        self.results += [GroupResult(group.name, Counter()) for group in groups]

    def _run_group(self, group: Group, environment: Mapping[str, str]) -> None:
        words = re.sub(r"\W+", "-", group.name)
        stem = f"{next(self._numbers):03}-{words}"
        report, output = self.folder / f"{stem}.xml", self.folder / f"{stem}.log"
        workers = ON_ALL_CORES if group.on_all_cores else ()
        deselections = [f"--deselect={entry}" for entry in group.deselected]
        command = [sys.executable, "-m", "pytest", f"--junitxml={report}", *workers, *deselections, *group.selectors]
        self._print(f"begins   {group.name} (about {group.seconds:.0f} s)")
        began = time.monotonic()
        self._running[stem] = group.name, began
        with output.open("wb") as stream:
            status = _run_to_the_end(command, stream, {**dict(group.variables), **environment})
        del self._running[stem]
        result = read_result(group.name, report, status)
        if result.succeeded:
            self.reports.append(report)
        self._finish(group, result, output, time.monotonic() - began)

    def _finish(self, group: Group, result: GroupResult, output: Path, seconds: float) -> None:
        if result.status == NO_TESTS_COLLECTED and group.deselected:
            self._print(f"nothing left in {group.name}: its tests are essential ones")
            return
        with self._printing:
            self.results.append(result)
            self._done_s += group.seconds
        if not result.succeeded:
            self._print(output.read_text(errors="replace"))
        counts = ", ".join(f"{count} {word}" for word, count in sorted(result.counts.items())) or "no result"
        self._print(f"ended    {group.name}: {counts} in {seconds:.0f} s{self._describe_remaining()}")

    def _report_running(self, stop_event: threading.Event) -> None:
        """Prints what runs and for how long, until everything has finished."""
        while not stop_event.wait(REPORT_S):
            now = time.monotonic()
            names = ", ".join(f"{name} for {now - began:.0f} s" for name, began in list(self._running.values()))
            self._print(f"running  {names}{self._describe_remaining()}")

    def _describe_remaining(self) -> str:
        """Returns the time that is left if the rest goes on at the pace of what has ended."""
        if not self._done_s or self._done_s >= self._expected_s:
            return ""
        elapsed_s = time.monotonic() - self._started
        remaining_min = elapsed_s * (self._expected_s - self._done_s) / self._done_s / 60
        return f"; about {max(1, round(remaining_min))} min left"

    def _print(self, text: str) -> None:
        with self._printing:
            sys.stdout.write(f"{text}\n")
            sys.stdout.flush()


def _run_to_the_end(command: Sequence[str], stream: IO[bytes], environment: Mapping[str, str]) -> int:
    """Runs a program and returns its exit status. Ctrl-C reaches the program too: it is given the time to clean up."""
    process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, env=dict(environment))
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.wait()
        raise
