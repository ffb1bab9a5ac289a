"""Sums up several pytest runs in one closing summary.

A report is a JUnit file (`junit_family=xunit1`, which names the test's file). The last line printed has the form of pytest's
own closing line and counts all parts. A part that left no report, found no tests or ended before its last test is an error.
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
class Part:
    """The result of one pytest run.

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
        """Nothing is known of it, or it found no tests: an error, whatever the other parts say."""
        return self.seconds is None or not self.counts


def read(name: str, path: Path, status: int = 0) -> Part:
    """The part as its report tells it; a test that fails and then fails again in its teardown counts once."""
    try:
        suite = ET.parse(path).getroot().find("testsuite")  # noqa: S314 - written by our own pytest
    except (OSError, ET.ParseError):
        suite = None
    if suite is None:
        return Part(name, Counter(), status=status)
    outcomes: dict[str, str] = {}
    for case in suite.iter("testcase"):
        said = [BAD.get(child.tag, child.tag) for child in case]
        outcome = next((word for word in ("failed", "error", "skipped") if word in said), "passed")
        known = outcomes.setdefault(find_test_id(case), outcome)
        if known == "passed":
            outcomes[find_test_id(case)] = outcome
    bad = tuple(test for test, outcome in outcomes.items() if outcome in BAD.values())
    return Part(name, Counter(outcomes.values()), bad, float(suite.get("time", 0)), status)


def find_test_id(case: ET.Element) -> str:
    """Returns the id of a test case of a report, as pytest takes it on its command line."""
    file, name, where = (case.get(key, "") for key in ("file", "name", "classname"))
    if not where:
        return file or name  # a file that could not be collected
    classes = where.removeprefix(file.removesuffix(".py").replace("/", ".")).strip(".")
    return "::".join(filter(None, (file, *classes.split("."), name)))


def summary(parts: Sequence[Part]) -> Iterable[str]:
    """The lines: a table of the parts, what failed, and a closing line that counts everything."""
    wide = max((len(part.name) for part in parts), default=0)
    yield f"{'part':{wide}}  passed  failed  skipped  seconds"
    for part in parts:
        if part.missing:
            yield f"{part.name:{wide}}  {'did not finish' if part.seconds is None else 'found no tests'}"
            continue
        counts, seconds = part.counts, part.seconds or 0
        yield f"{part.name:{wide}}  {counts['passed']:6}  {len(part.bad):6}  {counts['skipped']:7}  {seconds:7.1f}"
    for part in parts:
        if part.broken:
            yield f"BROKEN {part.name}: pytest ended with status {part.status}; its output is above"
    for part in parts:
        for test in part.bad:
            yield f"FAILED {test}"
    yield closing(parts)


def closing(parts: Sequence[Part]) -> str:
    """pytest's closing line, over all parts."""
    total = sum((part.counts for part in parts), Counter[str]())
    errors = total.pop("error", 0) + sum(part.missing or part.broken for part in parts)
    total["error" if errors == 1 else "errors"] = errors
    words = ("failed", "passed", "skipped", "error", "errors")
    said = ", ".join(f"{total[word]} {word}" for word in words if total[word])
    seconds = sum(part.seconds or 0 for part in parts)
    spelt = f" ({timedelta(seconds=int(seconds))})" if seconds >= 60 else ""
    return f" {said or 'no tests ran'} in {seconds:.2f}s{spelt} ".center(WIDTH, "=")
