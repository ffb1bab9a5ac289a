"""Measures what suspended apps of the largest accepted size cost the operator, also one that starts when they are there.

Three shapes: long text, many small parts, and long environments (few, since the API server takes seconds for each).
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from campaigns.common.options import report
from campaigns.common.output import save, say
from campaigns.common.process_use import peak_rss_bytes, tree_rss_bytes
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_api.checks.size import measure_spec
from robotapp_testbed import ControlPlane, Process, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.topology import fleet

MIB: Final = 1 << 20
LIMIT_MIB: Final = 512.0
"""The chart's limit of the operator."""
START_S: Final = 180.0
_ENV: Final = [{"name": f"A{index}"} for index in range(128)]

Json = dict[str, Any]


def make_app(name: str, components: Sequence[Json]) -> Json:
    spec = {"suspend": True, "ros": {"distro": "humble"}, "components": list(components)}
    return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": name}, "spec": spec}


def make_text_app(name: str) -> Json:
    """Sixteen variables of 30 kB, two in each component."""
    variables = [{"name": variable, "value": "x" * 30_000} for variable in ("A", "B")]
    return make_app(name, [{"name": f"c{n}", "image": "x", "env": variables} for n in range(8)])


def make_parts_app(name: str) -> Json:
    """Hundreds of devices: short JSON, many objects."""
    devices = [{"name": f"d{n}", "type": "video"} for n in range(8)]
    return make_app(name, [{"name": f"c{n}", "image": "x", "devices": devices} for n in range(41)])


def make_environment_app(name: str) -> Json:
    """Twenty-six thousand variables."""
    steps = [{"name": f"i{n}", "image": "x", "env": _ENV} for n in range(8)]
    pod = {"spec": {"initContainers": steps}}
    return make_app(name, [{"name": f"c{n}", "image": "x", "env": _ENV, "template": pod} for n in range(23)])


SHAPES: Final[Mapping[str, Callable[[str], Json]]] = {
    "text": make_text_app,
    "parts": make_parts_app,
    "environment": make_environment_app,
}


def measure(site: SimulatedSite, counts: Mapping[str, int]) -> dict[str, float]:
    """Creates so many apps of each shape and returns figures, of the running operator and of one that starts then."""
    figures = {"operator MiB before": tree_rss_bytes(site.operator.pid) / MIB}
    names = []
    for shape, count in counts.items():
        size = measure_spec(SHAPES[shape]("x")["spec"]).total_bytes
        say(f"{count} apps of {size // 1024} KiB each: {shape}")
        began_s = time.monotonic()
        for number in range(count):
            names.append(f"{shape}-{number}")
            site.create(SHAPES[shape](names[-1]))
        figures[f"{shape} apps"] = float(count)
        figures[f"{shape} s to create"] = time.monotonic() - began_s
    figures["apps with a status"] = float(sum(await_status(site, name) for name in names))
    figures["operator MiB after"] = tree_rss_bytes(site.operator.pid) / MIB
    figures["operator MiB peak"] = peak_rss_bytes(site.operator.pid) / MIB
    figures["operator ended"] = float(not site.operator.running)
    starting = site.another_operator()
    await_quiet(starting)
    figures["started operator MiB peak"] = peak_rss_bytes(starting.pid) / MIB
    figures["started operator ended"] = float(not starting.running)
    figures["scheduler MiB peak"] = peak_rss_bytes(site.scheduler.pid) / MIB
    return figures


def await_status(site: SimulatedSite, name: str) -> bool:
    """Waits for the first status of an app and returns whether it came."""
    return wait_until(lambda: bool(site.app(name).get("status", {}).get("observedGeneration")), timeout_s=60)


def await_quiet(process: Process) -> None:
    """Waits until a process that was started has read everything."""
    wait_until(lambda: _is_quiet(process), timeout_s=START_S, poll_s=2.0)


def _is_quiet(process: Process) -> bool:
    """Tells whether a process used a processor for less than a tenth of a second."""
    before_s = process.cpu_seconds()
    time.sleep(1.0)
    return process.cpu_seconds() - before_s < 0.1


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench large_apps", description=__doc__.splitlines()[0])
    for shape, count in (("text", 100), ("parts", 95), ("environment", 5)):
        parser.add_argument(f"--{shape}", type=int, default=count, help=f"apps of this shape (default: {count})")
    parser.add_argument("--json", type=report, help="write every figure to this file")
    options = parser.parse_args(argv)
    with ControlPlane() as cp:
        product.install(cp)
        with SimulatedSite(cp, fleet(), tidy=False) as site:
            figures = measure(site, {shape: getattr(options, shape) for shape in SHAPES})
    save(options.json, figures)
    for name, value in figures.items():
        say(f"{name}: {value:.4g}")
    peaks = (figures["operator MiB peak"], figures["started operator MiB peak"])
    return int(max(peaks) > LIMIT_MIB or figures["operator ended"] + figures["started operator ended"] > 0)


if __name__ == "__main__":
    sys.exit(main())
