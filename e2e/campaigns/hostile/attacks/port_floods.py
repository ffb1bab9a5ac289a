"""Strangers without credentials open thousands of connections to the ports of operator and scheduler."""

import json
import selectors
import subprocess
import sys
from collections.abc import Callable
from typing import Any, Final, Self

from campaigns.common.process_use import tree_rss_bytes
from campaigns.hostile.attack import (
    MIB,
    READY_S,
    RETURNED_MIB,
    Outcome,
    judge,
    measure_kept,
    read_memory_limit,
    register,
)
from campaigns.hostile.bystanders import Bystanders, measure_calm
from campaigns.hostile.port_flood import MODES
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import Process
from robotapp_testbed.binaries.pins import REPOSITORY
from robotapp_testbed.control_plane.servers import answers

CONNECTIONS: Final = 10_000
ADDRESSES: Final = 2_000
APPS: Final = 8
"""The connections are held until so many apps of others became Ready beside them."""
SAMPLE_S: Final = 0.2


@register("flood-operator", f"{CONNECTIONS} idle and half-open connections to the operator's port")
def flood_operator(site: SimulatedSite) -> Outcome:
    return flood(site, site.operator, "operator")


@register("flood-scheduler", f"{CONNECTIONS} idle and half-open connections to the scheduler's port")
def flood_scheduler(site: SimulatedSite) -> Outcome:
    return flood(site, site.scheduler, "scheduler")


@register("crowd-operator", f"the same to the operator's port from {ADDRESSES} addresses")
def crowd_operator(site: SimulatedSite) -> Outcome:
    return flood(site, site.operator, "operator", addresses=ADDRESSES)


@register("crowd-scheduler", f"the same to the scheduler's port from {ADDRESSES} addresses")
def crowd_scheduler(site: SimulatedSite) -> Outcome:
    return flood(site, site.scheduler, "scheduler", addresses=ADDRESSES)


class Attacker:
    """The program `port_flood`, running: it opens connections, then holds them until `end`."""

    def __init__(self, url: str, *, connections: int, addresses: int) -> None:
        command = ["campaigns.hostile.port_flood", url, "--connections", str(connections)]
        command += ["--addresses", str(addresses)]
        command += [word for mode in MODES for word in ("--mode", mode)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", *command], cwd=REPOSITORY, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def __repr__(self) -> str:
        return f"<Attacker {self._process.pid}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def open(self, sample: Callable[[], None]) -> dict[str, Any]:
        """Returns the report when all connections are open; calls `sample` meanwhile."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._stdout(), selectors.EVENT_READ)
            while not selector.select(SAMPLE_S):
                sample()
        return self._read()

    def end(self) -> dict[str, Any]:
        """Ends the attack and returns what is known only then."""
        if self._process.stdin is not None:
            self._process.stdin.close()
            self._process.stdin = None
        return self._read()

    def _read(self) -> dict[str, Any]:
        line = self._stdout().readline()
        if not line:
            raise RuntimeError(f"the attacker ended with {self._process.wait()}")
        report: dict[str, Any] = json.loads(line)
        return report

    def _stdout(self) -> Any:
        return self._process.stdout


class Samples:
    """Memory of a process and unanswered probes, one sample each time it is called."""

    def __init__(self, process: Process) -> None:
        self._process = process
        self.peak_bytes = 0
        self.silences = 0

    def __repr__(self) -> str:
        return f"<Samples: peak {self.peak_bytes / MIB:.0f} MiB, {self.silences} probes without an answer>"

    def __call__(self) -> None:
        self.peak_bytes = max(self.peak_bytes, tree_rss_bytes(self._process.pid))
        self.silences += not answers(f"{self._process.health_url}/healthz")


def flood(
    site: SimulatedSite, process: Process, component: str, *, connections: int = CONNECTIONS, addresses: int = 1
) -> Outcome:
    """Floods the port while bystanders apply apps, and returns what that cost the process and them."""
    calm_s = measure_calm(site, component)
    before_bytes = tree_rss_bytes(process.pid)
    sample = Samples(process)
    with (
        Bystanders(site, f"beside-{component}") as bystanders,
        Attacker(str(process.health_url), connections=connections, addresses=addresses) as attacker,
    ):
        report = attacker.open(sample)
        for _ in range(APPS):
            bystanders.wait_for_more(1)
            sample()
        report |= attacker.end()

    figures = {
        "connections opened": float(report["opened"]),
        "refused": float(report["refused"]),
        "held at the end": float(report["held"]),
        "opening s": report["opening_s"],
        f"{component} MiB before": before_bytes / MIB,
        f"{component} MiB peak": sample.peak_bytes / MIB,
        f"{component} MiB kept": measure_kept(process, before_bytes),
        "probes without an answer": float(sample.silences),
        "restarts": float(not process.running),
        "others' apps Ready before s": calm_s,
        "others' apps Ready s": bystanders.slowest_s,
        "others' apps": float(len(bystanders.ready_s)),
    }
    most = {
        f"{component} MiB peak": read_memory_limit(component) / MIB,
        f"{component} MiB kept": RETURNED_MIB,
        "probes without an answer": 0,
        "restarts": 0,
        "others' apps Ready s": max(READY_S, calm_s),
    }
    return judge(figures, most)
