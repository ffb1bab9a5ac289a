"""The demo and a smoke suite on control planes of other Kubernetes versions, which are compiled at their first use.

Compiling one version takes about ten minutes on two cores. What ran live here is what docs/installation.md lists as such.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from campaigns.common import options
from campaigns.common.output import save
from robotapp_testbed.binaries import pins, versions
from robotapp_testbed.progress import Progress
from suite.summary import GroupResult, read_result

SMOKE: Final = (
    "tests/live/chart/test_installation_live.py",
    "tests/live/chart/test_policies_live.py",
    "tests/live/crds/test_objects_live.py",
    "tests/live/crds/test_rules_live.py",
    "tests/live/crds/test_rule_costs_live.py",
    "tests/live/attacks/test_forged_members.py",
    "tests/live/claims/test_sweep.py",
    "tests/live/operating/apps/test_life_of_an_app.py",
    "tests/live/scheduling/ros/test_apps_live.py",
    "tests/live/scheduling/pods/test_pods_live.py",
    "tests/live/scheduling/ros/test_devices_live.py",
)
"""What touches the API server in every way we do: CRDs, rules, policies, apply, bindings with grants, watches, sweeps."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench versions", description=__doc__)
    parser.add_argument("--version", action="append", choices=[*versions.OTHERS], help="only this one; may be repeated")
    parser.add_argument("--json", type=options.report, help="also write the results to this file")
    arguments = parser.parse_args(argv)
    progress = Progress()
    results = [_run(minor, progress) for minor in arguments.version or versions.OTHERS]
    for result in results:
        print(told(result))
    save(arguments.json, results)
    return int(any(result["failed"] for result in results))


def told(result: Mapping[str, Any]) -> str:
    demo = "the demo passed" if result["demo"] else "THE DEMO FAILED"
    names = f": {', '.join(result['bad'])}" if result["bad"] else ""
    return (
        f"Kubernetes {result['version']}: {demo} in {result['demo_s']:.0f} s, "
        f"{result['passed']} smoke tests passed and {len(result['bad'])} failed in {result['smoke_s']:.0f} s{names}"
    )


def _run(minor: str, progress: Progress) -> dict[str, Any]:
    folder = versions.servers(minor, progress=progress)
    answer = subprocess.run([folder / "kube-apiserver", "--version"], capture_output=True, text=True, check=True)
    version = answer.stdout.split()[-1]
    if version != versions.OTHERS[minor]:
        raise SystemExit(f"{folder}/kube-apiserver is {version} and not {versions.OTHERS[minor]}: delete that folder")
    env = {**os.environ, "ROBOTAPP_ASSETS": str(folder)}
    began_s = time.monotonic()
    demo = subprocess.run([sys.executable, "-m", "journeys.demo", "--once"], cwd=pins.REPOSITORY, env=env, check=False)
    told_s = time.monotonic()
    results = smoke(env)
    bad = [name for result in results for name in (result.bad or ([] if result.succeeded else [result.name]))]
    return {
        "version": version,
        "demo": demo.returncode == 0,
        "demo_s": told_s - began_s,
        "passed": sum(result.counts["passed"] for result in results),
        "bad": bad,
        "smoke_s": time.monotonic() - told_s,
        "failed": demo.returncode != 0 or bool(bad),
    }


def smoke(env: Mapping[str, str]) -> list[GroupResult]:
    """Runs the smoke suite folder by folder, each with a control plane of its own, as `scripts/test` does."""
    results: list[GroupResult] = []
    with tempfile.TemporaryDirectory() as reports:
        for folder in dict.fromkeys(str(Path(name).parent) for name in SMOKE):
            report = Path(reports) / f"{len(results)}.xml"
            files = [name for name in SMOKE if str(Path(name).parent) == folder]
            command = [sys.executable, "-m", "pytest", "-q", f"--junitxml={report}", *files]
            status = subprocess.run(command, cwd=pins.REPOSITORY, env=dict(env), check=False).returncode
            results.append(read_result(folder, report, status))
    return results


if __name__ == "__main__":
    sys.exit(main())
