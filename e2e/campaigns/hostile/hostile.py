"""Attacks by people with small rights, or none: what they cost operator, scheduler and everybody else, with limits.

Each attack runs on a small simulated site with a fresh operator and scheduler, while bystanders apply apps of their own.
"""

import argparse
import importlib
import os
import pkgutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from campaigns.common.options import report
from campaigns.common.output import save, say
from campaigns.hostile import attacks
from campaigns.hostile.attack import ATTACKS, Attack, read_quota
from campaigns.rigs.live import CLAIMS
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.failures import TestbedError

FREED_S = 120.0
MOST_CLAIMS = 20


def main(argv: Sequence[str] | None = None) -> int:
    import_attacks()
    options = _parser().parse_args(argv)
    if options.list:
        print("\n".join(f"{attack.name:24} {attack.text}" for attack in ATTACKS.values()))
        return 0
    results = run([ATTACKS[name] for name in options.only or ATTACKS])
    save(options.json, results)
    print("\n".join(make_table(results)))
    return 1 if any(result["missed"] for result in results.values()) else 0


def import_attacks() -> None:
    """Imports every module of the folder of attacks, which fills `ATTACKS`."""
    for module in pkgutil.iter_modules(attacks.__path__, f"{attacks.__name__}."):
        importlib.import_module(module.name)


def run(selection: Sequence[Attack]) -> dict[str, dict[str, Any]]:
    """Returns figures and missed limits by the attack's name; an attack that ends in an error has missed everything."""
    results: dict[str, dict[str, Any]] = {}
    with ControlPlane() as cp:
        # The testbed leaves the quota out. It stays for the whole run: an app that was refused an id must not get one between attacks.
        quota = {"default": read_quota()}
        product.install(cp, values={"domainPool": {"quarantineSeconds": 1, "quota": quota}})
        for attack in selection:
            say(f"{attack.name}: {attack.text}")
            began_s = time.monotonic()
            figures: dict[str, float] = {}
            failures: list[str] = []
            try:
                with SimulatedSite(cp, attack.nodes(), tidy=False) as site, freeing_ids(site):
                    outcome = attack.run(site)
                    figures, failures = dict(outcome.figures), list(outcome.missed)
            except (AssertionError, LookupError, OSError, RuntimeError, TestbedError) as error:
                failures.append(f"it ended with {type(error).__name__}: {error}")
            results[attack.name] = {
                "figures": figures,
                "missed": failures,
                "seconds": time.monotonic() - began_s,
                "load": os.getloadavg()[0],
            }
            for line in describe(attack.name, results[attack.name]):
                say(line)
    return results


@contextmanager
def freeing_ids(site: SimulatedSite) -> Iterator[None]:
    """Deletes the site's apps at the end of the block, and waits until hardly any id is held. The nodes are still there then: pods on nodes
    that are gone would hold their ids for minutes, and the next attack would lack them.
    """
    try:
        yield
    finally:
        site.cp.api.delete(site.apps_path)
        wait_until(lambda: len(site.cp.api.get(CLAIMS)["items"]) <= MOST_CLAIMS, timeout_s=FREED_S, poll_s=0.5)


def make_table(results: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Returns a row per figure, and one per missed limit; load is the machine's average of the last minute."""
    rows = [f"{'attack':24} {'figure':40} {'value':>10}"]
    for name, result in results.items():
        figures = {**result["figures"], "seconds": result["seconds"], "load": result["load"]}
        rows += [f"{name:24} {figure:40} {value:10.4g}" for figure, value in figures.items()]
        rows += [f"{name:24} MISSED: {text}" for text in result["missed"]]
    return rows


def describe(name: str, result: dict[str, Any]) -> list[str]:
    """Returns a line with the figures, and one per missed limit."""
    figures = ", ".join(f"{key} {value:.4g}" for key, value in result["figures"].items())
    return [f"{name}: {figures}", *(f"{name}: MISSED: {text}" for text in result["missed"])]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench hostile", description=__doc__.splitlines()[0])
    parser.add_argument("--only", action="append", choices=sorted(ATTACKS), help="this attack only (may be repeated)")
    parser.add_argument("--list", action="store_true", help="list the attacks and end")
    parser.add_argument("--json", type=report, help="write every figure to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
