"""The agent as a process on this machine, with a kubeconfig and a tree of its own instead of the host's files."""

import os
import sys
from pathlib import Path
from typing import Any

from robotapp_api.model.names import API_VERSION
from robotapp_testbed import ControlPlane, Process
from robotapp_testbed.control_plane.servers import answers
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes import ports

TELEMETRY = f"/apis/{API_VERSION}/nodetelemetries"


def agent(plane: ControlPlane, node: str, *arguments: str, host_root: Path, interval_s: int = 1) -> Process:
    """Not started yet. Its /healthz tells that it serves."""
    (port,) = ports.free_ports(1)
    argv = [
        sys.executable,
        "-m",
        "robotapp_agent",
        f"--kubeconfig={plane.kubeconfig()}",
        f"--node-name={node}",
        f"--host-root={host_root}",
        f"--health-port={port}",
        f"--interval-seconds={interval_s}",
        *arguments,
    ]
    url = f"http://127.0.0.1:{port}/healthz"
    return Process(
        f"agent-{node}",
        argv,
        run_dir=plane.run_dir,
        log_path=plane.logs_dir / f"agent-{node}.log",
        env={name: value for name, value in os.environ.items() if name != "NODE_NAME"},
        ready=lambda: answers(url),
        health_url=url,
    )


def status_of(plane: ControlPlane, node: str) -> dict[str, Any]:
    """The status as stored, empty while there is none."""
    try:
        found: dict[str, Any] = plane.api.get(f"{TELEMETRY}/{node}").get("status", {})
    except ApiStatusError as error:
        if error.status != 404:
            raise
        return {}
    return found
