"""The page and the file of results."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from campaigns.mutants.catalogue import Fault


class Result(NamedTuple):
    """The test that noticed one fault. `test` is "" when nothing did, `is_over` False when time ran out before the tests did."""

    fault: Fault
    test: str
    stage: str
    is_daily: bool
    seconds: float
    is_over: bool = True


_HEAD: Final = """# Faults put in on purpose

A small fault is put into a copy of the product, and tests run until one fails: those of the touched package, the other unit
and property tests, the essential live tests, with `--rest` then everything else. Seconds are those of all tests up to
the one that failed. Made at commit {commit}; `e2e/campaigns/mutants/catalogue.py` has the faults.

```
{command}
```

**{daily} of {total} are noticed by `scripts/test`, {noticed} in all.**

| fault | what a user would suffer | noticed by | in | after |
|---|---|---|---|---|
"""


def render_page(results: Sequence[Result], *, command: str, commit: str) -> str:
    """Returns the page in Markdown."""
    head = _HEAD.format(
        command=command,
        commit=commit,
        daily=sum(bool(result.test) and result.is_daily for result in results),
        noticed=sum(bool(result.test) for result in results),
        total=len(results),
    )
    return head + "".join(map(_row, results))


def render_json(results: Sequence[Result], *, command: str, commit: str) -> dict[str, object]:
    """Returns the results as plain data."""
    faults = [
        {
            "name": result.fault.name,
            "harm": result.fault.harm,
            "file": result.fault.file,
            "noticed_by": result.test or None,
            "stage": result.stage,
            "by_scripts_test": bool(result.test) and result.is_daily,
            "all_tests_ran": result.is_over,
            "seconds": round(result.seconds, 1),
        }
        for result in results
    ]
    return {"command": command, "commit": commit, "faults": faults}


def _row(result: Result) -> str:
    noticed = f"`{result.test}`" if result.test else "nothing" if result.is_over else "nothing before time ran out"
    cells = (f"`{result.fault.name}`", result.fault.harm, noticed, result.stage, f"{result.seconds:.0f} s")
    return f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |\n"
