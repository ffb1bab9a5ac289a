"""The product against the scalar reference in `e2e/campaigns/reference_scheduler`: many seeded cases, no cluster.

The families take turns at the centre of a case. A case is named by seed and number, so that `--seed S --case N` shows it
again; its smallest form is found by making the numbers it was drawn from smaller.
"""

import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from campaigns.cluster_cases import FAMILIES, Case, replayed_case, seeded_case
from campaigns.reference_scheduler.comparison import differences

Json = dict[str, Any]
ATTEMPTS = 1500
"""Cases tried to make one that differs smaller."""


@dataclass
class Report:
    """counts: family at the centre to cases; found: number, families and differences of each case that differs."""

    counts: Counter[str] = field(default_factory=Counter)
    unequal: Counter[str] = field(default_factory=Counter)
    found: list[Json] = field(default_factory=list)
    smallest: str = ""
    seconds: float = 0.0

    def table(self) -> str:
        rows = [f"{'family':26}{'cases':>8}{'differences':>13}"]
        rows += [f"{name:26}{count:8}{self.unequal[name]:13}" for name, count in sorted(self.counts.items())]
        return "\n".join(rows)

    def as_json(self) -> Json:
        return {
            "cases": self.counts.total(),
            "families": dict(self.counts),
            "differences": self.found,
            "smallest": self.smallest,
            "seconds": self.seconds,
        }


def judged(case: Case) -> list[str]:
    """The differences; a crash of the product is one, and must not end the campaign."""
    try:
        return differences(case)
    except Exception as error:  # noqa: BLE001 - whatever the product raises is the finding
        return [f"{type(error).__name__}: {error}"]


def campaign(*, cases: int, seed: str, say: Callable[[str], None]) -> Report:
    """Compare `cases` cases; the first that differs is made small."""
    report = Report()
    started = time.monotonic()
    for number in range(cases):
        case = seeded_case(seed, number=number, families=list(FAMILIES))
        report.counts[case.families[0]] += 1
        if unequal := judged(case):
            report.unequal[case.families[0]] += 1
            report.found.append({"number": number, "families": case.families, "differences": unequal})
            if not report.smallest:
                report.smallest = described(shrunk(case))
        if number % 2000 == 1999:
            say(f"{number + 1}/{cases} cases, {len(report.found)} differences")
    report.seconds = time.monotonic() - started
    return report


def one(*, seed: str, number: int) -> str:
    """A single case of a campaign, small if it differs."""
    case = seeded_case(seed, number=number, families=list(FAMILIES))
    return described(shrunk(case) if judged(case) else case)


def described(case: Case) -> str:
    lines = [f"families: {', '.join(case.families)}", *(f"- {each}" for each in judged(case) or ["no difference"])]
    return "\n".join([*lines, *(json.dumps(each) for each in case.objects)])


def shrunk(case: Case) -> Case:
    """The smallest case found that still differs."""
    first = case.families[0]
    left = ATTEMPTS
    progress = True
    while progress and left > 0:
        progress = False
        for numbers in _smaller(case.numbers):
            left -= 1
            tried = replayed_case(numbers, first=first, families=list(FAMILIES))
            if _weight(tried.numbers) < _weight(case.numbers) and judged(tried):
                case, progress = tried, True
                break
            if left <= 0:
                break
    return case


def _weight(numbers: Sequence[int]) -> tuple[int, int]:
    return len(numbers), sum(numbers)


def _smaller(numbers: Sequence[int]) -> Iterator[list[int]]:
    """Parts taken out, from large to small; then single numbers to 0 and by half."""
    size = len(numbers)
    while size >= 1:
        for start in range(0, len(numbers), size):
            yield [*numbers[:start], *numbers[start + size :]]
        size //= 2
    for at, number in enumerate(numbers):
        for value in {0, number // 2, number - 1}:
            if 0 <= value < number:
                yield [*numbers[:at], value, *numbers[at + 1 :]]
