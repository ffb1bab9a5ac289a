"""kube-scheduler as an oracle: a process with a talkative log, and what that log says about each decision.

The score lines are written once per feasible node, so they are the feasible set (when two or more nodes are feasible);
with one feasible node scoring is skipped, and with none the pod's condition holds the histogram.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from campaigns.parity.profiles import profiles
from robotapp_testbed import ControlPlane
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.processes.process import Process

SCHEDULER_NAME = "oracle"
_SCORE = re.compile(r'"Plugin scored node for pod" pod="([^"]+)" plugin="([^"]+)" node="([^"]+)" score=(-?\d+)')
_TOTAL = re.compile(r'"Calculated node\'s final score for pod" pod="([^"]+)" node="([^"]+)" score=(-?\d+)')


def start(cp: ControlPlane) -> Process:
    """kube-scheduler with our profiles: all nodes scored, one goroutine, no ranking re-used between pods."""
    config = cp.run_dir / "oracle.yaml"
    kubeconfig = str(cp.kubeconfig("kube-scheduler"))
    document = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "clientConnection": {"kubeconfig": kubeconfig, "qps": 10000, "burst": 10000},
        "leaderElection": {"leaderElect": False},
        "percentageOfNodesToScore": 100,
        "parallelism": 1,
        "profiles": profiles(SCHEDULER_NAME),
    }
    config.write_text(yaml.safe_dump(document))
    binary = Assets().resolve(["kube-scheduler"])["kube-scheduler"]
    argv = [
        binary,
        f"--config={config}",
        "--secure-port=0",
        "--feature-gates=OpportunisticBatching=false",
        "--vmodule=schedule_one*=10",
    ]
    return Process("oracle", argv, run_dir=cp.run_dir, log_path=cp.logs_dir / "oracle.log").start()


@dataclass(slots=True)
class Scores:
    """Per feasible node: the weighted score of each plugin, and the total."""

    plugins: dict[str, dict[str, int]] = field(default_factory=dict)
    totals: dict[str, int] = field(default_factory=dict)

    @property
    def best(self) -> set[str]:
        top = max(self.totals.values(), default=0)
        return {node for node, total in self.totals.items() if total == top}


class OracleLog:
    """Follows the log file and gathers the scores of every pod ("namespace/name")."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset = 0
        self._rest = ""
        self.pods: dict[str, Scores] = {}

    def read(self) -> dict[str, Scores]:
        """Take in what was written since the last call."""
        with self._path.open("rb") as file:
            file.seek(self._offset)
            data = file.read()
        self._offset += len(data)
        lines = (self._rest + data.decode(errors="replace")).split("\n")
        self._rest = lines.pop()
        for line in lines:
            self.take(line)
        return self.pods

    def take(self, line: str) -> None:
        if found := _SCORE.search(line):
            pod, plugin, node, score = found.groups()
            self.pods.setdefault(pod, Scores()).plugins.setdefault(node, {})[plugin] = int(score)
        elif found := _TOTAL.search(line):
            pod, node, score = found.groups()
            self.pods.setdefault(pod, Scores()).totals[node] = int(score)
