"""Compiles the chart's CEL expressions as each Kubernetes release does, and prints what the CRDs' rules cost at most.

The API server takes a schema of at most 100 million units. The program is compiled at its first use (some minutes).
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from campaigns.common import options
from campaigns.versions.expressions import RELEASES, compiled, compiler, errors, rendered, write
from robotapp_testbed.progress import Progress

LIMIT = 100_000_000
LARGEST = 5


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench cel", description=__doc__)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    arguments = parser.parse_args(argv)
    program = compiler(Progress())
    with tempfile.TemporaryDirectory() as folder:
        found = compiled(program, write(rendered(RELEASES[-1]), Path(folder)))
    for report in found:
        rules = [cost for cost in report["costs"] if cost["units"]]
        units = f", {report['total']:,} of {LIMIT:,} units" if rules else ""
        print(f"{Path(report['file']).stem}: {len(report['costs'])} expressions{units}")
        for cost in rules[:LARGEST]:
            print(f"  {cost['units']:>10,} {cost['kind']:<7} {cost['path']}: {cost['text'][:100]}")
    broken = {release: _broken(program, release) for release in RELEASES}
    for release, problems in broken.items():
        print(f"{release}: {'; '.join(problems) or 'compiles'}")
    if arguments.json:
        arguments.json.write_text(json.dumps({"costs": found, "errors": broken}, indent=1) + "\n")
    return int(any(report["total"] > LIMIT for report in found) or any(broken.values()))


def _broken(program: Path, release: str) -> list[str]:
    with tempfile.TemporaryDirectory() as folder:
        return errors(compiled(program, write(rendered(release), Path(folder)), release=release))


if __name__ == "__main__":
    sys.exit(main())
