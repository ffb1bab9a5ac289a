"""Strangers without credentials open thousands of connections to the ports of operator and scheduler."""

import json
import subprocess
import sys
import time
from typing import Any, Final

from campaigns.common.process_use import tree_rss_bytes
from campaigns.hostile.attack import MIB, Outcome, judge, read_memory_limit, register
from campaigns.hostile.bystanders import Bystanders
from campaigns.hostile.port_flood import MODES
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import Process
from robotapp_testbed.binaries.pins import REPOSITORY
from robotapp_testbed.control_plane.servers import answers

CONNECTIONS: Final = 10_000
HELD_S: Final = 30.0
READY_S: Final = 3.0
CALM_S: Final = 10.0
"""Bystanders alone, before: where a busy machine takes longer than READY_S by itself, the attack may not make it worse."""
RETURNED_MIB: Final = 16.0
REST_S: Final = 40.0
"""Longer than every deadline of the port."""


@register("flood-operator", f"{CONNECTIONS} idle and half-open connections to the operator's port")
def flood_operator(site: SimulatedSite) -> Outcome:
    return flood(site, site.operator, "operator")


@register("flood-scheduler", f"{CONNECTIONS} idle and half-open connections to the scheduler's port")
def flood_scheduler(site: SimulatedSite) -> Outcome:
    return flood(site, site.scheduler, "scheduler")


def flood(
    site: SimulatedSite, process: Process, component: str, *, connections: int = CONNECTIONS, held_s: float = HELD_S
) -> Outcome:
    """Floods the port while bystanders apply apps, and returns what that cost the process and them."""
    before_pid, before_bytes = process.pid, tree_rss_bytes(process.pid)
    peak_bytes, silences = before_bytes, 0
    with Bystanders(site, f"before-{component}") as calm:
        time.sleep(CALM_S)
    modes = [word for mode in MODES for word in ("--mode", mode)]
    command = ["campaigns.hostile.port_flood", str(process.health_url), *modes]
    command += ["--connections", str(connections), "--seconds", str(held_s), "--source", "127.0.0.2"]
    with Bystanders(site, f"beside-{component}") as bystanders:
        attacker = subprocess.Popen([sys.executable, "-m", *command], cwd=REPOSITORY, stdout=subprocess.PIPE)
        try:
            while attacker.poll() is None:
                peak_bytes = max(peak_bytes, tree_rss_bytes(process.pid))
                silences += not answers(f"{process.health_url}/healthz")
                time.sleep(0.2)
            report: dict[str, Any] = json.loads(attacker.communicate()[0])
        finally:
            attacker.kill()
            attacker.wait()
    time.sleep(REST_S)
    figures = {
        "connections opened": float(report["opened"]),
        "refused": float(report["refused"]),
        "held at the end": float(report["held"]),
        "opening s": report["opening_s"],
        f"{component} MiB before": before_bytes / MIB,
        f"{component} MiB peak": peak_bytes / MIB,
        f"{component} MiB kept": (tree_rss_bytes(process.pid) - before_bytes) / MIB,
        "probes without an answer": float(silences),
        "restarts": float(process.pid != before_pid or not process.running),
        "others' apps Ready before s": calm.slowest_s,
        "others' apps Ready s": bystanders.slowest_s,
        "others' apps": float(len(bystanders.ready_s)),
    }
    most = {
        f"{component} MiB peak": read_memory_limit(component) / MIB,
        f"{component} MiB kept": RETURNED_MIB,
        "probes without an answer": 0,
        "restarts": 0,
        "others' apps Ready s": max(READY_S, calm.slowest_s),
    }
    return judge(figures, most)
