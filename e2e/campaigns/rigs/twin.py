"""kube-scheduler beside ours on the same API server, and what both serve as metrics."""

import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import yaml

from robotapp_testbed import ControlPlane
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.processes import ports
from robotapp_testbed.processes.process import Process

THEIRS: Final = "upstream-scheduler"


@contextmanager
def kube_scheduler(cp: ControlPlane, folder: Path, *flags: str) -> Iterator[str]:
    """Runs it for pods of THEIRS; the address of its metrics."""
    (port,) = ports.free_ports(1)
    kubeconfig = str(cp.kubeconfig("kube-scheduler"))
    document = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "clientConnection": {"kubeconfig": kubeconfig},
        "leaderElection": {"leaderElect": False},
        "profiles": [{"schedulerName": THEIRS}],
    }
    config = folder / "twin.yaml"
    config.write_text(yaml.safe_dump(document))
    argv = [
        str(Assets().resolve(["kube-scheduler"])["kube-scheduler"]), f"--config={config}", f"--secure-port={port}",
        "--bind-address=127.0.0.1", f"--authentication-kubeconfig={kubeconfig}", "--authentication-skip-lookup",
        f"--authorization-kubeconfig={kubeconfig}", "--authorization-always-allow-paths=/metrics", *flags,
    ]  # fmt: skip
    url = f"https://127.0.0.1:{port}"
    log = cp.logs_dir / "twin.log"
    process = Process("twin", argv, run_dir=folder, log_path=log, ready=lambda: _serves(url)).start()
    try:
        process.wait_ready()
        yield url
    finally:
        process.stop()


def _serves(url: str) -> bool:
    try:
        return bool(scraped(url))
    except OSError:
        return False


def scraped(url: str) -> str:
    """The page at /metrics."""
    with urllib.request.urlopen(f"{url}/metrics", context=unverified()) as answer:  # noqa: S310 - our own
        text: str = answer.read().decode()
    return text
