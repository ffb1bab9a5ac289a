"""Who is measured, each started fresh and warm: held back by a lease until the clock starts, or free at once."""

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from campaigns.speed.workloads import Workload
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import LEASES
from robotapp_client.transport.errors import NotFound
from robotapp_testbed import ControlPlane
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.processes.process import Process

RETRY_S = 0.5


@dataclass(frozen=True, slots=True)
class Contestant:
    """By the name it is given on the command line and the schedulerName it serves."""

    name: str
    scheduler_name: str
    lease: str
    lease_namespace: str
    decides: bool = True
    """False: it binds to the next node in turn without looking, and leaves what cannot be placed alone."""
    events: bool = True


OURS = Contestant("robotapp", "ros-aware-scheduler", "robotapp-scheduler", "robotapp-system")
KUBE_SCHEDULER = Contestant("kube-scheduler", "default-scheduler", "kube-scheduler", "kube-system")
BARE = Contestant("bare", "bench-bare", OURS.lease, OURS.lease_namespace, decides=False)
BARE_NO_EVENTS = Contestant(
    "bare-no-events", "bench-quiet", OURS.lease, OURS.lease_namespace, decides=False, events=False
)
CONTESTANTS: Mapping[str, Contestant] = {each.name: each for each in (OURS, KUBE_SCHEDULER, BARE, BARE_NO_EVENTS)}


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


def start(cp: ControlPlane, contestant: Contestant, workload: Workload, *, leader_elect: bool) -> Process:
    """A fresh process of the contestant; with `leader_elect` it waits for its lease, caches warm."""
    if not contestant.decides:
        return _start_bare(cp, contestant, workload, leader_elect=leader_elect)
    config = cp.run_dir / f"{contestant.name}.config.yaml"
    if contestant is OURS:
        config.write_text(yaml.safe_dump(configuration(contestant, None, leader_elect=leader_elect)))
        return start_scheduler(cp, config=config)
    kubeconfig = cp.kubeconfig("kube-scheduler")
    config.write_text(yaml.safe_dump(configuration(contestant, kubeconfig, leader_elect=leader_elect)))
    binary = Assets().resolve(["kube-scheduler"])["kube-scheduler"]
    argv = [binary, f"--config={config}", "--secure-port=0", "-v=0"]
    return _adopt(cp, "bench-kube-scheduler", argv)


def _start_bare(cp: ControlPlane, contestant: Contestant, workload: Workload, *, leader_elect: bool) -> Process:
    """As our scheduler's user: an admin would skip the checks of its rights."""
    argv = [sys.executable, "-m", "campaigns.speed.bare"]
    argv += [f"--kubeconfig={cp.kubeconfig('scheduler')}", f"--scheduler-name={contestant.scheduler_name}"]
    argv += [
        f"--victims={workload.victims}",
        f"--devices={workload.devices}",
        *([] if contestant.events else ["--no-events"]),
    ]
    argv += [f"--lease={contestant.lease_namespace}/{contestant.lease}"] if leader_elect else []
    return _adopt(cp, "bench-bare", argv)


def _adopt(cp: ControlPlane, name: str, argv: list[Any]) -> Process:
    environment = dict(os.environ) | {"PYTHONPATH": str(Path(__file__).parents[3])}
    process = Process(name, argv, run_dir=cp.run_dir, log_path=cp.logs_dir / f"{name}.log", env=environment)
    return cp.add_process(process).start()


async def hold_lease(client: ApiClient, contestant: Contestant) -> None:
    """Take a scheduler's lease, so that it warms up and waits."""
    await drop_lease(client, contestant)
    now = time.strftime("%Y-%m-%dT%H:%M:%S.000000Z", time.gmtime())
    spec = {"holderIdentity": "bench", "leaseDurationSeconds": 3600, "acquireTime": now, "renewTime": now}
    await client.create(
        LEASES, {"metadata": {"name": contestant.lease, "namespace": contestant.lease_namespace}, "spec": spec}
    )


async def drop_lease(client: ApiClient, contestant: Contestant) -> None:
    try:
        await client.delete(LEASES, contestant.lease, namespace=contestant.lease_namespace)
    except NotFound:
        return
