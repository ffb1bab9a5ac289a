"""Profile: damaged copies of a hostile package: no traceback, nothing outside the package touched, no profile that takes a second.

scripts/bench profile_hostile --packages 2000 --seed 1 --json FILE
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from campaigns.common import options
from campaigns.profile.hostile_package import Hostile, everything, seconds

HANG_S = 1.0
"""Processor time of one profile in all formats, above which a package hangs the profiler."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="scripts/bench profile_hostile", description=__doc__.splitlines()[0] if __doc__ else ""
    )
    parser.add_argument("--packages", type=options.count(1, 1_000_000), default=2000, help="damaged copies to try")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        result = _campaign(Hostile.made(Path(folder)), arguments.packages, arguments.seed)
    text = json.dumps(result, indent=2)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    return 1 if result["problems"] else 0


def _campaign(hostile: Hostile, packages: int, first: int) -> dict[str, object]:
    everything(hostile.folder)  # once, so that nothing is imported later
    problems: list[str] = []
    slowest, total = 0.0, 0.0
    for seed in range(first, first + packages):
        with hostile.damaged(seed) as names:
            found = hostile.problems()
            spent = seconds(hostile)
        slowest, total = max(slowest, spent), total + spent
        if spent > HANG_S:
            found.append(f"it took {spent:.2f} s")
        problems += (f"seed {seed}, {', '.join(names)}: {text}" for text in found)
    return {
        "packages": packages,
        "first_seed": first,
        "slowest_s": round(slowest, 3),
        "mean_s": round(total / packages, 4),
        "problems": problems[:50],
    }


if __name__ == "__main__":
    sys.exit(main())
