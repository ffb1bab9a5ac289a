"""Compiles the chart's CEL expressions as each Kubernetes release does, and prints what the CRDs' rules cost at most.

The API server takes a schema of at most 100 million units. The program is compiled at its first use (some minutes).
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.live.chart.chart import CHART, NAMESPACE, Object

from campaigns.common import options
from campaigns.common.output import save
from robotapp_testbed.binaries import programs
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.product import REGISTRY
from robotapp_testbed.progress import Progress

RELEASES = ("1.32", "1.33", "1.34", "1.35", "1.36", "1.37")
"""Every release that the chart names: Chart.yaml has the first as its kubeVersion, docs/installation.md lists them all."""
COMPILED = ("CustomResourceDefinition", "ValidatingAdmissionPolicy")
"""Kinds whose expressions the program compiles."""

EVERY_POLICY = ("agent.labeller.enabled=true",)
"""Values with which the chart has all its policies."""

Report = dict[str, Any]


def compiler(progress: Progress | None = None) -> Path:
    """The program. Compiled at its first use, which takes some minutes where nothing of Kubernetes has been compiled."""
    return programs.build("cel-cost", progress=progress)


def rendered(release: str, *values: str) -> list[Object]:
    """The chart as helm renders it for that release; CalledProcessError when the chart refuses the release."""
    helm = Assets().resolve(["helm"])["helm"]
    given = [part for value in (*EVERY_POLICY, *values) for part in ("--set", value)]
    command = [
        helm,
        "template",
        "robotapp",
        CHART,
        "--namespace",
        NAMESPACE,
        "--kube-version",
        f"{release}.0",
        "--set",
        f"imageRegistry={REGISTRY}",
        *given,
    ]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    return product.objects_of(answer.stdout)


def write(objects: Iterable[Object], folder: Path) -> list[Path]:
    """One file for each object with expressions that are compiled."""
    found = []
    for item in objects:
        if item["kind"] in COMPILED:
            path = folder / f"{item['kind']}-{item['metadata']['name']}.yaml"
            path.write_text(json.dumps(item))  # JSON is YAML
            found.append(path)
    return found


def with_expressions(item: Object) -> bool:
    """Has the object a field that holds CEL, whatever its kind?"""
    return any(key in ("expression", "messageExpression", "x-kubernetes-validations", "cel") for key in _keys(item))


def _keys(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        for key, child in value.items():
            yield key
            yield from _keys(child)
    elif isinstance(value, list):
        for child in value:
            yield from _keys(child)


def compiled(program: Path, files: Sequence[Path], *, release: str = "") -> list[Report]:
    """Per file its expressions with cost and error. Without a release they compile as the newest API server's do."""
    chosen = ["-release", release] if release else []
    answer = subprocess.run([program, *chosen, *files], capture_output=True, text=True, check=True)
    found: list[Report] = json.loads(answer.stdout)
    return found


def errors(reports: Iterable[Report]) -> list[str]:
    return [
        f"{Path(report['file']).name} {cost['path']}: {cost['error']}"
        for report in reports
        for cost in report["costs"]
        if cost.get("error")
    ]


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
    save(arguments.json, {"costs": found, "errors": broken})
    return int(any(report["total"] > LIMIT for report in found) or any(broken.values()))


def _broken(program: Path, release: str) -> list[str]:
    with tempfile.TemporaryDirectory() as folder:
        return errors(compiled(program, write(rendered(release), Path(folder)), release=release))


if __name__ == "__main__":
    sys.exit(main())
