"""Static cost of the CRDs' CEL rules, as the API server estimates it; and on which Kubernetes releases they compile.

The API server takes a schema of at most 100 million units. The program is compiled at its first use (some minutes).
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.bench import options

from robotapp_testbed import pins, programs
from robotapp_testbed.progress import Progress

LIMIT = 100_000_000
RELEASES = ("1.32", "1.33", "1.34", "1.35", "1.36", "1.37")
LARGEST = 5


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench cel", description=__doc__)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    arguments = parser.parse_args(argv)
    program = programs.build("cel-cost", progress=Progress())
    files = sorted((pins.REPOSITORY / "crds").glob("*.yaml"))
    found = _costs(program, files)
    for report in found:
        print(f"{Path(report['file']).name}: {report['total']:,} of {LIMIT:,}")
        for cost in report["costs"][:LARGEST]:
            print(f"  {cost['units']:>10,} {cost['kind']:<7} {cost['path']}: {cost['text'][:100]}")
    broken = {release: _errors(_costs(program, files, release=release)) for release in RELEASES}
    for release, errors in broken.items():
        print(f"{release}: {'compiles' if not errors else '; '.join(errors)}")
    if arguments.json:
        arguments.json.write_text(json.dumps({"costs": found, "errors": broken}, indent=1) + "\n")
    return int(any(report["total"] > LIMIT for report in found) or any(broken.values()))


def _costs(program: Path, files: Sequence[Path], *, release: str = "") -> list[dict[str, Any]]:
    chosen = ["-version", release] if release else []
    answer = subprocess.run([program, *chosen, *files], capture_output=True, text=True, check=True)
    found: list[dict[str, Any]] = json.loads(answer.stdout)
    return found


def _errors(reports: Sequence[dict[str, Any]]) -> list[str]:
    return [f"{cost['path']}: {cost['error']}" for report in reports for cost in report["costs"] if cost.get("error")]


if __name__ == "__main__":
    sys.exit(main())
