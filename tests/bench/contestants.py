"""The schedulers that are measured, each started fresh, warm and held back by a lease until the clock starts."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from robotapp_testbed import ControlPlane
from robotapp_testbed.assets import Assets
from robotapp_testbed.process import Process
from robotapp_testbed.product import start_scheduler

RETRY_S = 0.5


@dataclass(frozen=True, slots=True)
class Contestant:
    """A scheduler by the name it is given on the command line and the schedulerName it serves."""

    name: str
    scheduler_name: str
    lease: str
    lease_namespace: str


OURS = Contestant("robotapp", "ros-aware-scheduler", "robotapp-scheduler", "robotapp-system")
KUBE_SCHEDULER = Contestant("kube-scheduler", "default-scheduler", "kube-scheduler", "kube-system")
CONTESTANTS: Mapping[str, Contestant] = {each.name: each for each in (OURS, KUBE_SCHEDULER)}


def configuration(contestant: Contestant, kubeconfig: Path | None, *, leader_elect: bool) -> dict[str, Any]:
    """The same file for both; only the API rate limit is lifted, which holds kube-scheduler to 50 requests/s else."""
    connection: dict[str, Any] = {"qps": 10000, "burst": 10000}
    if kubeconfig is not None:
        connection["kubeconfig"] = str(kubeconfig)
    election = {
        "leaderElect": leader_elect,
        "leaseDuration": "15s",
        "renewDeadline": "10s",
        "retryPeriod": f"{RETRY_S * 1000:.0f}ms",
        "resourceName": contestant.lease,
        "resourceNamespace": contestant.lease_namespace,
    }
    return {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "clientConnection": connection,
        "leaderElection": election,
        "profiles": [{"schedulerName": contestant.scheduler_name}],
    }


def start(cp: ControlPlane, contestant: Contestant, *, leader_elect: bool = True) -> Process:
    """A fresh process of the contestant; with `leader_elect` it waits for its lease, caches warm."""
    config = cp.run_dir / f"{contestant.name}.config.yaml"
    if contestant is OURS:
        config.write_text(yaml.safe_dump(configuration(contestant, None, leader_elect=leader_elect)))
        return start_scheduler(cp, config=config)
    kubeconfig = cp.kubeconfig("kube-scheduler")
    config.write_text(yaml.safe_dump(configuration(contestant, kubeconfig, leader_elect=leader_elect)))
    binary = Assets().resolve(["kube-scheduler"])["kube-scheduler"]
    log = cp.logs_dir / "bench-kube-scheduler.log"
    argv = [binary, f"--config={config}", "--secure-port=0", "-v=0"]
    return Process("kube-scheduler", argv, run_dir=cp.run_dir, log_path=log).start()
