"""Sums up several pytest processes in one closing summary.

A report is a JUnit file (`junit_family=xunit1`, which names the test's file). The last line printed has the form of pytest's
own closing line and counts all groups. A group that left no report, found no tests or ended before its last test is an error.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from xml.etree import ElementTree as ET

WIDTH = 80
BAD = {"failure": "failed", "error": "error"}


@dataclass(frozen=True, slots=True)
class GroupResult:
    """The result of one pytest process.

    `seconds` is None when it ended without a report (killed, or wrongly called); `status` is pytest's exit status: 0 or 1
    when all tests ran.
    """

    name: str
    counts: Counter[str]
    bad: tuple[str, ...] = ()
    seconds: float | None = None
    status: int = 0

    @property
    def succeeded(self) -> bool:
        """Returns True when pytest ran all tests and none failed."""
        return not (self.missing or self.bad or self.broken)

    @property
    def broken(self) -> bool:
        """Returns True when pytest ended otherwise than by running all tests, or failed without naming a test."""
        return self.status not in (0, 1) or (self.status == 1 and not self.bad and not self.missing)

    @property
    def missing(self) -> bool:
        """Returns True when the process left no report or found no tests: an error, whatever the other groups came to."""
        return self.seconds is None or not self.counts


def read_result(name: str, path: Path, status: int = 0) -> GroupResult:
    """Returns the result in a group's report. A test that fails, and then again in its teardown, counts once."""
    try:
        suite = ET.parse(path).getroot().find("testsuite")  # noqa: S314 - written by our own pytest
    except (OSError, ET.ParseError):
        suite = None
    if suite is None:
        return GroupResult(name, Counter(), status=status)
    outcomes: dict[str, str] = {}
    for case in suite.iter("testcase"):
        words = [BAD.get(child.tag, child.tag) for child in case]
        outcome = next((word for word in ("failed", "error", "skipped") if word in words), "passed")
        first_outcome = outcomes.setdefault(find_test_id(case), outcome)
        if first_outcome == "passed":
            outcomes[find_test_id(case)] = outcome
    bad = tuple(test for test, outcome in outcomes.items() if outcome in BAD.values())
    return GroupResult(name, Counter(outcomes.values()), bad, float(suite.get("time", 0)), status)


def find_test_id(case: ET.Element) -> str:
    """Returns the id of a test case of a report, as pytest takes it on its command line."""
    file, name, where = (case.get(key, "") for key in ("file", "name", "classname"))
    if not where:
        return file or name  # a file that could not be collected
    classes = where.removeprefix(file.removesuffix(".py").replace("/", ".")).strip(".")
    return "::".join(filter(None, (file, *classes.split("."), name)))


def format_summary(results: Sequence[GroupResult]) -> Iterable[str]:
    """Yields the lines: a table of the groups, what failed, and a closing line that counts everything."""
    width = max((len(result.name) for result in results), default=0)
    yield f"{'group':{width}}  passed  failed  skipped  seconds"
    for result in results:
        if result.missing:
            yield f"{result.name:{width}}  {'did not finish' if result.seconds is None else 'found no tests'}"
            continue
        counts, seconds = result.counts, result.seconds or 0
        yield f"{result.name:{width}}  {counts['passed']:6}  {len(result.bad):6}  {counts['skipped']:7}  {seconds:7.1f}"
    for result in results:
        if result.broken:
            yield f"BROKEN {result.name}: pytest ended with status {result.status}; its output is above"
    for result in results:
        for test in result.bad:
            yield f"FAILED {test}"
    yield format_closing_line(results)


def format_closing_line(results: Sequence[GroupResult]) -> str:
    """Returns pytest's closing line, over all groups."""
    total = sum((result.counts for result in results), Counter[str]())
    errors = total.pop("error", 0) + sum(result.missing or result.broken for result in results)
    total["error" if errors == 1 else "errors"] = errors
    words = ("failed", "passed", "skipped", "error", "errors")
    counts = ", ".join(f"{total[word]} {word}" for word in words if total[word])
    seconds = sum(result.seconds or 0 for result in results)
    duration = f" ({timedelta(seconds=int(seconds))})" if seconds >= 60 else ""
    return f" {counts or 'no tests ran'} in {seconds:.2f}s{duration} ".center(WIDTH, "=")
