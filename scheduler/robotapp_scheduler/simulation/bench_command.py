"""`python -m robotapp_scheduler bench-plugin module:Class`: what a plugin costs per pod, before it is enabled anywhere."""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any, Final, TextIO

import yaml

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_api.values import strict_yaml
from robotapp_scheduler.config.plugin_names import with_third_party
from robotapp_scheduler.core.framework.profiles import Catalogue, PluginRef, PluginSet, ProfileError, ProfileSpec
from robotapp_scheduler.core.framework.profiles import build_profiles as checked
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.simulation import synthetic
from robotapp_scheduler.simulation.bench import ROUNDS, Cost, Setting, measure
from robotapp_scheduler.simulation.report import replace_line

BOUND_PER_NODE: Final = 6


_LOADS: Final = {True: "replicas, class reused", False: "computed every time"}


def main(argv: Sequence[str], *, out: TextIO | None = None) -> int:
    """0 when measured, 2 when the plugin cannot be used, 1 when it answered something no plugin may answer."""
    found = _parser().parse_args(argv)
    known, problems = with_third_party(catalogue(), [found.plugin])
    if problems:
        return _failed(problems[found.plugin])
    try:
        arguments = strict_yaml.loads(found.args or "{}")
    except yaml.YAMLError as error:
        return _failed(f"--args: {error}")
    if not isinstance(arguments, dict):
        return _failed("--args: must be a mapping such as '{quiet: very}'")
    if hasattr(known.classes[found.plugin], "queue_key"):
        return _failed(f"{found.plugin} orders the queue: no hook of it is called while a node is looked for")
    enabled = PluginSet(enabled=(PluginRef(found.plugin, found.weight),))
    with_plugin = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": enabled}, plugin_config={found.plugin: arguments})
    without = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": PluginSet(disabled=(PluginRef(found.plugin),))})
    try:
        checked([with_plugin], known)
        checked([without], known)
    except ProfileError as error:
        return _failed(*error.problems)
    costs = list(_measured(found, known, with_plugin, without))
    replace_line(sys.stderr)
    target = out or sys.stdout
    if found.json:
        json.dump([asdict(cost) | {"share": cost.share} for cost in costs], target, indent=2)
        target.write("\n")
    else:
        target.write(table(found.plugin, costs))
    errors = [cost.error for cost in costs if cost.error]
    return _failed(errors[0], status=1) if errors else 0


def table(name: str, costs: Sequence[Cost]) -> str:
    """One line per cluster size and kind of load."""
    lines = [
        f"{name}: microseconds per pod, medians of {ROUNDS} rounds with and without it in turn",
        f"{'NODES':>7} {'PODS':>6}  {'LOAD':<22} {'PLUGIN':>9} {'CYCLE':>9} {'WITHOUT':>9} {'SHARE':>6}",
    ]
    lines += [
        f"{cost.nodes:>7} {cost.pods:>6}  {_LOADS[cost.reuse]:<22} {cost.plugin_us:>9.1f} {cost.cycle_us:>9.1f}"
        f" {cost.without_us:>9.1f} {cost.share:>6.1%}"
        for cost in costs
    ]
    lines += [f"{cost.unplaced} of {cost.pods} pods found no node" for cost in costs if cost.unplaced]
    return "\n".join(dict.fromkeys(lines)) + "\n"


def _measured(found: Any, known: Catalogue, with_plugin: ProfileSpec, without: ProfileSpec) -> Iterator[Cost]:
    for count in found.nodes:
        nodes = synthetic.nodes(count)
        bound = synthetic.bound(BOUND_PER_NODE * count, count)
        for reuse in (True, False):
            replace_line(sys.stderr, f"measuring with {count} nodes, {_LOADS[reuse]} ...")
            waiting = synthetic.waiting(found.pods if reuse else max(found.pods // 10, 1), SCHEDULER_NAME)
            yield measure(
                found.plugin,
                Setting(nodes, bound, waiting, reuse),
                catalogue=known,
                with_plugin=with_plugin,
                without=without,
                clock=time.perf_counter,
            )


def _failed(*problems: str, status: int = 2) -> int:
    for problem in problems:
        sys.stderr.write(f"error: {problem}\n")
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robotapp-scheduler bench-plugin",
        description="Measures what a plugin costs per pod on made-up clusters.",
        epilog="example: robotapp-scheduler bench-plugin mylab.quiet:QuietNodes --nodes 1000,5000",
    )
    parser.add_argument("plugin", metavar="PLUGIN", help="module:Class, an entry point, or a built-in plugin's name")
    parser.add_argument("--args", default="", metavar="YAML", help="its arguments, e.g. '{quiet: very}'")
    parser.add_argument("--weight", type=_weight, default=1, help="weight of its scores (default 1)")
    parser.add_argument(
        "--nodes", type=_counts, default=[1000, 5000], metavar="N,N", help="cluster sizes (default 1000,5000)"
    )
    parser.add_argument("--pods", type=_pods, default=500, help="pods to place (default 500; a tenth without reuse)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return parser


def _counts(text: str) -> list[int]:
    return [_between(part, 50_000, "cluster sizes are") for part in text.split(",")]


def _pods(text: str) -> int:
    return _between(text, 100_000, "pods to place are")


def _weight(text: str) -> int:
    return _between(text, (1 << 31) - 1, "weights are")


def _between(text: str, most: int, what: str) -> int:
    number = int(text) if text.strip().isascii() and text.strip().isdigit() and len(text) < 12 else 0
    if not 0 < number <= most:
        raise argparse.ArgumentTypeError(f"{what} 1 to {most}")
    return number
