"""Search every state of the claim protocol, with the product's decisions and with mutants that must be caught.

Without names also every case of a process that sleeps through a change of hands.
"""

import argparse
import sys

from tests.support.claims_model.scenarios import ALL
from tests.support.claims_zombies import CASES, first_failure


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench claims", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="SCENARIO", help=f"of {', '.join(ALL)}")
    parser.add_argument("--all", action="store_true", help="the large ones too (about ten minutes, up to 4 GB)")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in ALL]
    if unknown:
        parser.error(f"no scenario {', '.join(unknown)}; there are {', '.join(ALL)}")
    wrong = []
    chosen = options.names or [name for name, one in ALL.items() if one.quick or options.all]
    for name in chosen:
        scenario = ALL[name]
        result = scenario.run()
        expected = result.verdict in scenario.expect
        wrong += [] if expected else [name]
        print(f"{'  ' if expected else '??'} {scenario!s:70} {result}", flush=True)
    if not options.names and (failure := first_failure(CASES)):
        wrong.append(f"a process that slept: {failure}")
    print(f"unexpected: {', '.join(wrong)}" if wrong else f"all {len(chosen)} as expected")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
