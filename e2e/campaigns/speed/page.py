"""Writes the speed tables of docs/performance.md and its chart: scripts/bench page out.json [more.json …]

The files are those of `scripts/bench scheduler --json`; where several have the same row, the last one counts. Everything
between the two marks in the page is replaced, the rest stays.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from campaigns.speed.chart import chart
from campaigns.speed.markdown import section
from campaigns.speed.result import merged, read

BEGIN, END = "<!-- speed: made by scripts/bench page -->", "<!-- speed: end -->"
DOCS = Path(__file__).parents[3] / "docs"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench page", description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="+", metavar="FILE")
    parser.add_argument("--page", type=Path, default=DOCS / "performance.md")
    parser.add_argument("--chart", type=Path, default=DOCS / "performance.svg")
    arguments = parser.parse_args(argv)
    results = [read(path) for path in arguments.results]
    rows = merged(results)
    arguments.chart.write_text(chart(rows))
    text = section(rows, results, chart=arguments.chart.name)
    arguments.page.write_text(replaced(arguments.page.read_text(), text))
    return 0


def replaced(page: str, text: str, *, begin: str = BEGIN, end: str = END) -> str:
    """The page with `text` between the marks. Raises ValueError when it has none."""
    before, found_begin, rest = page.partition(begin)
    _, found_end, after = rest.partition(end)
    if not found_begin or not found_end:
        raise ValueError(f"the page has no lines {begin!r} and {end!r}")
    return f"{before}{begin}\n{text}\n{end}{after}"


if __name__ == "__main__":
    sys.exit(main())
