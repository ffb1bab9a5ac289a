"""Edges of launch files against those written out by hand: precision and recall of (topic, from, to)."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaigns.common.output import save
from ros_profile.generate import generate_profile
from ros_profile.model.conclusions import Profile

TRUTH = Path(__file__).parent / "data" / "profile_edges.jsonl"
LEAST_PRECISION, LEAST_RECALL = 0.9, 0.8
EXPLANATION = """\
The file names a launch file by repository and `package/path`, or `path` where the repository is one package. Its edges
are those between nodes whose source is in the checkout or which are well known; viewers, tf, lifecycle services and what
behaviour trees call are left out. Checkouts lie in DIR/<owner>+<repo>.
"""

Edge = tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class Compared:
    launch: str
    right: set[Edge]
    wrong: set[Edge]
    missed: set[Edge]


def compared(entry: dict[str, Any], profile: Profile) -> Compared:
    """One launch file's edges; everything is missed where the launch file is not found."""
    wanted = {(topic, source, target) for topic, source, target in entry["edges"]}
    found: set[Edge] = set()
    for package in profile.packages:
        for launch in package.launches:
            if f"{package.name}/{launch.file}" == entry["launch"] or launch.file == entry["launch"]:
                found = {(edge.topic, edge.source, edge.target) for edge in launch.edges}
    return Compared(entry["launch"], wanted & found, found - wanted, wanted - found)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; 0 when both bars are met."""
    parser = argparse.ArgumentParser(prog="scripts/bench profile_edges", description=__doc__, epilog=EXPLANATION)
    parser.add_argument("--checkouts", type=Path, required=True, metavar="DIR")
    parser.add_argument("--truth", type=Path, default=TRUTH, metavar="FILE")
    parser.add_argument("--no-curated", action="store_true", help="without the table of well-known nodes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures")
    arguments = parser.parse_args(argv)
    entries = [json.loads(line) for line in arguments.truth.read_text().splitlines()]
    profiles: dict[str, Profile] = {}
    for repo in {entry["repo"] for entry in entries}:
        folder = arguments.checkouts / repo.replace("/", "+")
        profiles[repo] = generate_profile(folder, engine="none", curated=not arguments.no_curated)
    figures = report([compared(entry, profiles[entry["repo"]]) for entry in entries])
    save(arguments.json, figures)
    return 0 if figures["precision"] >= LEAST_PRECISION and figures["recall"] >= LEAST_RECALL else 1


def report(results: Sequence[Compared]) -> dict[str, float]:
    """Print every difference and the figures."""
    for one in results:
        for sign, edges in (("wrong ", one.wrong), ("missed", one.missed)):
            for topic, source, target in sorted(edges):
                print(f"{sign} {one.launch}: {topic}  {source} -> {target}")
    right, wrong, missed = (sum(len(getattr(one, key)) for one in results) for key in ("right", "wrong", "missed"))
    figures = {
        "launch_files": len(results),
        "edges": right + missed,
        "precision": right / max(right + wrong, 1),
        "recall": right / max(right + missed, 1),
        "exact_launch_files": sum(not one.wrong and not one.missed for one in results),
    }
    print(
        "  ".join(
            f"{key} {value:.3f}" if isinstance(value, float) else f"{key} {value}" for key, value in figures.items()
        )
    )
    return figures


if __name__ == "__main__":
    sys.exit(main())
