"""Measures the language of the code, and compares the files that changed since the last landing with their state before.

Four measures over all Python files except tests: the share of functions whose name begins with a verb, the share of locals named
by a participle or pronoun, the share of docstrings that open with a fragment, and the number of names that belong to another
class than that of their annotation. `language_measures.py` beside this file defines them, `language_words.toml` lists the words.

The revision to compare with is the commit `landed` in `.ci/landing.json`. The files that changed are taken together, renames are
followed, and what only moved from one file to another counts on neither side. Their figures must not be worse than before. What is
new in new files must reach the goals in `MEASURES`.

`python scripts/language.py` prints the figures and every finding, and ends with 1 when there are any; `--figures` prints the
figures only; `--base REV` compares with another revision; `--worst N` lists the N files with most to mend.
"""

import argparse
import io
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Final, NamedTuple

from language_measures import Item, Place, read_items

from suite import landing
from suite.repository import has_history, list_names, list_python_files, run_git

ROOT = Path(__file__).resolve().parent.parent
MOST_FINDINGS: Final = 30
"""Findings printed per measure; the rest is counted."""


class Measure(NamedTuple):
    """The goal for what is new in new files, and how a finding is mended."""

    name: str
    share: float
    """Greatest share of findings; 0 where their number is the figure."""
    free: int
    """So many findings are allowed anyway, because shares of small numbers mean little."""
    goal: str
    cure: str


MEASURES: Final = (
    Measure(
        "verbs", 0.40, 2, "60 % or more", "begin the name with a verb, or add a verb to scripts/language_words.toml"
    ),
    Measure("locals", 0.03, 1, "3 % or less", "name what the value is, with a noun: `feasible_nodes`, not `found`"),
    Measure("docstrings", 0.03, 1, "3 % or less", "begin with what it is or does, in a whole sentence: `Returns …`"),
    Measure("leftovers", 0.0, 0, "none", "name it like its class: `cache: Cache`, not `cluster: Cache`"),
)


class Figure(NamedTuple):
    """Findings among the items of one measure."""

    measure: Measure
    findings: int
    items: int

    def count_excess(self, before: "Figure | None" = None) -> int:
        """Returns how many findings must go for a figure as good as before, or as the goal where nothing was before."""
        if before and not self.measure.share:
            allowance = before.findings
        elif before and before.items:
            allowance = before.findings * self.items // before.items
        else:
            allowance = max(self.measure.free, int(self.measure.share * self.items + 1e-9))
        return max(0, self.findings - allowance)

    def format(self) -> str:
        """Returns the figure for the table: the share with verbs, the share of findings, or their number."""
        if not self.measure.share:
            return str(self.findings)
        if not self.items:
            return "-"
        share = 100 * self.findings / self.items
        return f"{100 - share if self.measure.name == 'verbs' else share:.1f} %"


class Pair(NamedTuple):
    """A file that differs from the base: its path there and its path now, None where it does not exist."""

    before: str | None
    now: str | None


class Tree:
    """The items of many files. Annotated names count only where the class is one of `classes` or defined in these files."""

    def __init__(self, texts: Mapping[str, str], classes: AbstractSet[str] = frozenset()) -> None:
        files = {path: read_items(path, text) for path, text in texts.items()}
        self.classes = set(classes).union(*(file.classes for file in files.values()))
        self.places = {
            path: [
                place
                for place in file.places
                if place.item.measure != "leftovers" or place.item.name.rpartition(" ")[2] in self.classes
            ]
            for path, file in files.items()
        }

    def list_places(self, paths: Iterable[str]) -> list[Place]:
        """Returns the items of these files with their lines."""
        return [place for path in paths for place in self.places[path]]

    def count_items(self, paths: Iterable[str]) -> Counter[Item]:
        """Returns how often each item is in these files."""
        return Counter(place.item for place in self.list_places(paths))


def compute_figure(items: Counter[Item], measure: Measure) -> Figure:
    """Returns the figure of one measure."""
    counts = [(item.is_finding, count) for item, count in items.items() if item.measure == measure.name]
    return Figure(measure, sum(count for is_finding, count in counts if is_finding), sum(count for _, count in counts))


class Comparison:
    """Two states of the files that differ. Items that only moved from one file to another are on neither side."""

    def __init__(self, pairs: list[Pair], before: Tree, now: Tree) -> None:
        self.new_paths = [pair.now for pair in pairs if pair.now and not pair.before]
        self.changed_paths = [pair.now for pair in pairs if pair.now and pair.before]
        self.tree = now
        items_before = before.count_items(pair.before for pair in pairs if pair.now and pair.before)
        items_of_deleted_files = before.count_items(pair.before for pair in pairs if pair.before and not pair.now)
        items_now = now.count_items(self.changed_paths)
        items_of_new_files = now.count_items(self.new_paths)
        common_items = items_before & items_now
        lost_items = items_before - common_items
        self.additions = items_now - common_items - items_of_deleted_files
        self.before = common_items + (lost_items - items_of_new_files)
        self.now = common_items + self.additions
        self.new = items_of_new_files - items_of_deleted_files - lost_items

    def format_rows(self) -> Iterator[str]:
        """Yields the rows of the table that follow those of the packages."""
        yield format_row("changed files before", self.before)
        yield format_row("changed files now", self.now)
        yield format_row("new in new files", self.new)

    def list_findings(self) -> Iterator[str]:
        """Yields a line for each measure that is missed, and below it the findings that may be mended."""
        for measure in MEASURES:
            before, now, new = (compute_figure(items, measure) for items in (self.before, self.now, self.new))
            excess = min(now.count_excess(before), compute_figure(self.additions, measure).findings)
            if excess:
                yield f"{measure.name}: {now.format()} in changed files, {before.format()} before; mend {excess} of:"
                yield from self._locate(self.additions, measure, self.changed_paths)
            excess = new.count_excess()
            if excess:
                yield f"{measure.name}: {new.format()} of what is new in new files, goal {measure.goal}; mend {excess} of:"
                yield from self._locate(self.new, measure, self.new_paths)

    def _locate(self, items: Counter[Item], measure: Measure, paths: list[str]) -> Iterator[str]:
        """Yields file, line, name and cure of the findings among the items."""
        counts = Counter(
            {item: count for item, count in items.items() if item.is_finding and item.measure == measure.name}
        )
        lines = []
        for place in self.tree.list_places(paths):
            if counts[place.item]:
                counts[place.item] -= 1
                lines.append(f"  {place.path}:{place.line}: `{place.item.name}`: {measure.cure}")
        yield from lines[:MOST_FINDINGS]
        if len(lines) > MOST_FINDINGS:
            yield f"  … and {len(lines) - MOST_FINDINGS} more"


def is_measured(path: str) -> bool:
    """Returns True for a Python file that is no test."""
    *folders, name = path.split("/")
    return name.endswith(".py") and "tests" not in folders and name != "conftest.py" and not name.startswith("test_")


def list_sources() -> list[str]:
    """Returns the files that are measured."""
    return [name for name in list_python_files(ROOT) if is_measured(name)]


def list_pairs(revision: str, sources: AbstractSet[str]) -> list[Pair]:
    """Returns the files that differ from the revision, renames followed.

    Tests are left out, but not those that were deleted or became product code: their helpers may have moved there.
    """
    fields = iter(list_names("diff", "-z", "--name-status", "-M", "-l0", revision, "--", "*.py", root=ROOT))
    pairs = []
    for status in fields:
        before = next(fields)
        now = next(fields) if status.startswith("R") else before
        pair = Pair(None if status == "A" else before, now if now in sources else None)
        if pair.now or is_measured(before) or status == "D":
            pairs.append(pair)
    tracked_names = set(list_names("ls-files", "-z", "*.py", root=ROOT))
    return pairs + [Pair(None, path) for path in sorted(sources - tracked_names)]


def read_blobs(revision: str, paths: list[str]) -> dict[str, str]:
    """Returns the text of files of a revision, read by one process."""
    output = io.BytesIO(
        run_git("cat-file", "--batch", root=ROOT, stdin="".join(f"{revision}:{path}\n" for path in paths))
    )
    texts = {}
    for path in paths:
        size = int(output.readline().split()[2])
        texts[path] = output.read(size).decode()
        output.readline()
    return texts


def name_package(path: str) -> str:
    """Returns the import package of a file; `e2e` and `scripts` are taken whole."""
    root, _, rest = path.partition("/")
    if root in {"e2e", "scripts"} or "/" not in rest or (ROOT / root / "__init__.py").is_file():
        return root
    return rest.partition("/")[0]


def format_row(title: str, items: Counter[Item]) -> str:
    """Returns one row of the table."""
    figures = [compute_figure(items, measure) for measure in MEASURES]
    return f"{title:<22}{figures[0].items:>9}" + "".join(f"{figure.format():>12}" for figure in figures)


def format_table(tree: Tree) -> Iterator[str]:
    """Yields the figures of each package and of all together."""
    packages: dict[str, Counter[Item]] = {}
    for path in tree.places:
        packages.setdefault(name_package(path), Counter()).update(tree.count_items([path]))
    yield f"{'':<22}{'functions':>9}" + "".join(f"{measure.name:>12}" for measure in MEASURES)
    for title, items in sorted(packages.items()):
        yield format_row(title, items)
    yield format_row("all", sum(packages.values(), Counter()))


def list_worst(tree: Tree, count: int) -> Iterator[str]:
    """Yields the files with most findings and their number per measure."""
    findings = {
        path: Counter(place.item.measure for place in places if place.item.is_finding)
        for path, places in tree.places.items()
    }
    for path, counts in sorted(findings.items(), key=lambda row: (-row[1].total(), row[0]))[:count]:
        yield (
            f"{counts.total():5} {path} ("
            + ", ".join(f"{name} {number}" for name, number in sorted(counts.items()))
            + ")"
        )


def parse_arguments() -> argparse.Namespace:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--figures", action="store_true", help="print the figures only")
    parser.add_argument(
        "--base", metavar="REV", help="compare with this revision, not with the one in .ci/landing.json"
    )
    parser.add_argument("--worst", metavar="N", type=int, help="list the N files with most to mend")
    return parser.parse_args()


def find_base(revision: str | None) -> str:
    """Returns the commit to compare with: that of the last landing, or the one the command line names."""
    if revision is None:
        base = landing.read_landing(ROOT).landed
        landing.check_landed(base, ROOT)
        return base
    try:
        return run_git("rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}", root=ROOT).decode().strip()
    except subprocess.CalledProcessError:
        raise landing.LandingError(f"--base {revision}: this repository has no such commit") from None


def compare(tree: Tree, revision: str | None) -> list[str]:
    """Prints the figures of what differs from the base. Returns the findings."""
    if not has_history(ROOT):
        print("Nothing compared: this is no git repository, so that nothing is known of the state before.")
        return []
    try:
        base = find_base(revision)
    except landing.LandingError as error:
        return [f"Nothing compared: {error}"]
    pairs = list_pairs(base, tree.places.keys())
    blobs = read_blobs(base, [pair.before for pair in pairs if pair.before])
    comparison = Comparison(pairs, Tree(blobs, tree.classes), tree)
    print(f"\nsince {base[:12]}:", *comparison.format_rows(), sep="\n")
    return list(comparison.list_findings())


def main() -> int:
    """Prints what the command line asks for. Returns 1 when there are findings."""
    options = parse_arguments()
    tree = Tree({path: (ROOT / path).read_text() for path in list_sources()})
    if options.worst:
        print(*list_worst(tree, options.worst), sep="\n")
        return 0
    print(*format_table(tree), sep="\n")
    findings = [] if options.figures else compare(tree, options.base)
    for finding in findings:
        print(finding)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
