"""Search every state of the claim protocol, with the product's decisions and with mutants that must be caught.

At the end the table of docs/claims.md is gone through: each of the twelve weaker rules must be caught by each scenario
that the table names for it, as far as these were run. Without names also every
case of a process that sleeps through a change of hands is tried.
"""

import argparse
import sys
from collections.abc import Mapping

from campaigns.claims.claims_weakened import FOUND_BY_MODELS
from campaigns.claims.claims_zombies import CASES, first_failure
from campaigns.claims.model.explore import Result
from campaigns.claims.model.scenarios import ALL


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench claims", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="SCENARIO", help=f"of {', '.join(ALL)}")
    parser.add_argument("--all", action="store_true", help="the large ones too (about ten minutes, up to 4 GB)")
    parser.add_argument("--table", action="store_true", help="only those that the table of weaker rules names")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in ALL]
    if unknown:
        parser.error(f"no scenario {', '.join(unknown)}; there are {', '.join(ALL)}")
    results = {}
    for name in options.names or _chosen(everything=options.all, table=options.table):
        results[name] = ALL[name].run()
        mark = "  " if _expected(name, results[name]) else "??"
        print(f"{mark} {ALL[name]!s:70} {results[name]}", flush=True)
    wrong = [name for name, result in results.items() if not _expected(name, result)]
    if not options.names and not options.table and (failure := first_failure(CASES)):
        wrong.append(f"a process that slept: {failure}")
    print(f"unexpected: {', '.join(wrong)}" if wrong else f"all {len(results)} as expected")
    missed = _table(results)
    return bool(wrong or missed)


def _chosen(*, everything: bool, table: bool) -> list[str]:
    if table:
        return [name for name in ALL if any(name in found for found in FOUND_BY_MODELS.values())]
    return [name for name, one in ALL.items() if one.quick or everything]


def _expected(name: str, result: Result) -> bool:
    return result.verdict in ALL[name].expect


def _table(results: Mapping[str, Result]) -> list[str]:
    """Print what caught each weaker rule; the names of those that one of its scenarios did not catch."""
    missed = []
    tried = {weak: names for weak, names in FOUND_BY_MODELS.items() if results.keys() & set(names)}
    for weak, names in tried.items():
        found = {name: results[name].verdict for name in names if name in results}
        if not all(_expected(name, results[name]) and verdict != "OK" for name, verdict in found.items()):
            missed.append(weak)
        told = ", ".join(f"{name} {verdict}" for name, verdict in found.items())
        left = [name for name in names if name not in results]
        print(
            f"{'??' if weak in missed else '  '} {weak:22} {told}{' (not run: ' + ', '.join(left) + ')' if left else ''}"
        )
    if tried:
        caught = len(tried) - len(missed)
        print(f"weaker rules caught by the models: {caught} of {len(tried)} that were tried, of {len(FOUND_BY_MODELS)}")
    return missed


if __name__ == "__main__":
    sys.exit(main())
