"""The two schedulers that are compared: names, configurations, processes."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Final

import yaml

from campaigns.speed import contestants
from campaigns.speed.workloads import WORKLOADS
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.processes.process import Process


@dataclass(frozen=True, slots=True)
class Contender:
    """A scheduler and the schedulerName of its pods."""

    name: str
    scheduler_name: str


OURS: Final = Contender("robotapp", SCHEDULER_NAME)
KUBE_SCHEDULER: Final = Contender("kube-scheduler", "default-scheduler")
BOTH: Final = (OURS, KUBE_SCHEDULER)


@dataclass(frozen=True, slots=True)
class Running:
    """A contender and its process."""

    contender: Contender
    process: Process

    @contextmanager
    def away(self) -> Iterator[None]:
        """The scheduler is stopped while this lasts, so that it finds all at once what is created meanwhile."""
        self.process.stop()
        yield
        self.process.start().wait_ready()


@contextmanager
def started(cp: ControlPlane) -> Iterator[tuple[Running, ...]]:
    """Both, with no difference but their plugins; they end with this."""
    with ExitStack() as stack:
        config = cp.run_dir / "scenarios.config.yaml"
        config.write_text(yaml.safe_dump(_configuration()))
        ours = start_scheduler(cp, config, name="scheduler-scenarios", sweep_seconds=1, log_format="text")
        stack.callback(ours.stop)
        theirs = contestants.start(cp, contestants.KUBE_SCHEDULER, WORKLOADS["basic"], leader_elect=False)
        stack.callback(theirs.stop)
        yield Running(OURS, ours), Running(KUBE_SCHEDULER, theirs)


def _configuration() -> dict[str, Any]:
    """Ours as it is shipped."""
    return {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaderElect": False},
        "profiles": [{"schedulerName": SCHEDULER_NAME}],
    }
