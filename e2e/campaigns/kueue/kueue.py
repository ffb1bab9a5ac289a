"""Jobs of an app in a queue of kueue: its real controller manager admits them, and our operator does not decide against it.

A ClusterQueue has room for two of four Jobs. Two run, the others stay suspended until those have ended; then the queue is drained while
Jobs run, by which kueue suspends them, and opened again. Every state of the Jobs is judged, and the writes of either side are counted.
Nodes and kubelets are simulated; control plane, Job controller, kueue, operator and scheduler are real. The manager is compiled
first where the cache does not have it, which takes minutes.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.kueue import manager
from campaigns.kueue.job_history import JobHistory, judge
from campaigns.kueue.objects import CPUS, JOBS, ROOM, make_app, make_queue
from campaigns.rigs.live import APPS, CLAIMS, Tenant, eventually, pool
from robotapp_api.model.names import Phase
from robotapp_testbed import ControlPlane
from robotapp_testbed.binaries import kueue as kueue_binary
from robotapp_testbed.control_plane import audit, product
from robotapp_testbed.control_plane.identity import OPERATOR_ACCOUNT, service_account
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines import topology

Json = dict[str, Any]
PATIENCE_S: Final = 120.0
HELD_S: Final = 5.0
"""How long a drained queue is watched: the operator looks at each app every second."""
SHAPES: Final = ("sweep", "components")


@dataclass(slots=True)
class Outcome:
    """Holds what was seen of one app. `writes`: successful ones of its Jobs' spec, by who made them."""

    shape: str
    is_drained: bool
    seconds: float = 0.0
    most_at_once: int = 0
    turns: dict[str, list[bool]] = field(default_factory=dict)
    writes: dict[str, int] = field(default_factory=dict)
    pods: int = 0
    claims_left: int = 0
    problems: list[str] = field(default_factory=list)


class Story:
    """One app in the queue of a namespace, from its creation until all of its Jobs have ended."""

    def __init__(self, cp: ControlPlane, namespace: str, outcome: Outcome) -> None:
        self.cp = cp
        self.tenant = Tenant(cp, namespace)
        self.outcome = outcome

    def run(self, pool_name: str) -> None:
        began_s = time.monotonic()
        name = f"queued-{self.outcome.shape}"
        with JobHistory(self.cp, self.tenant.namespace) as history:
            self.cp.api.create(APPS.format(self.tenant.namespace), make_app(name, self.outcome.shape, pool_name))
            self.expect(lambda: self.count_running() == ROOM, f"{ROOM} of {JOBS} Jobs run")
            self.expect(lambda: len(self.list_jobs()) == JOBS, f"there are {JOBS} Jobs")
            if self.outcome.is_drained:
                self.drain()
            self.expect(
                lambda: sum(job["status"].get("succeeded", 0) for job in self.list_jobs()) == JOBS, "all Jobs succeed"
            )
            self.expect(lambda: self.tenant.app(name)["status"].get("phase") == Phase.COMPLETED, "the app is Completed")
            self.expect(lambda: not self.tenant.claims(), "no domain is held")
            self.outcome.claims_left = len(self.tenant.claims())
            self.outcome.pods = len(self.tenant.listed("pods"))
            self.outcome.seconds = round(time.monotonic() - began_s, 1)
        verdict = judge(history.changes, ROOM)
        self.outcome.most_at_once, self.outcome.turns = verdict.most_at_once, verdict.turns
        self.outcome.problems += verdict.problems
        courses = [[True, False], [True, False, True, False]] if self.outcome.is_drained else [[True, False]]
        self.outcome.problems += [
            f"suspend of {job} went {values}" for job, values in verdict.turns.items() if values not in courses
        ]
        self.outcome.writes = count_writes(self.cp, self.tenant.namespace)
        self.tenant.delete(name)
        self.expect(lambda: not self.list_jobs(), "the Jobs go with the app")

    def drain(self) -> None:
        """Has kueue suspend the Jobs that run, and lets them go on; meanwhile nothing may run."""
        self.set_policy("HoldAndDrain")
        self.expect(lambda: self.count_running() == 0, "kueue suspends the Jobs that run")
        until_s = time.monotonic() + HELD_S
        while time.monotonic() < until_s:
            if job_count := self.count_running():
                self.outcome.problems.append(f"{job_count} Jobs run although the queue is drained")
                break
            time.sleep(0.2)
        self.set_policy("None")
        self.expect(lambda: self.count_running() == ROOM, f"{ROOM} Jobs run again")

    def set_policy(self, policy: str) -> None:
        path = f"/apis/kueue.x-k8s.io/v1beta2/clusterqueues/{self.tenant.namespace}"
        self.cp.api.patch(path, {"spec": {"stopPolicy": policy}})

    def list_jobs(self) -> list[Json]:
        return self.tenant.listed("batch/jobs")

    def count_running(self) -> int:
        """Returns how many Jobs have a pod that runs and are not suspended."""
        return sum(not job["spec"]["suspend"] and job["status"].get("active", 0) > 0 for job in self.list_jobs())

    def expect(self, condition: Callable[[], object], what: str) -> None:
        eventually(condition, timeout_s=PATIENCE_S, what=lambda: f"{what}: {self.describe()}")

    def describe(self) -> str:
        """Returns what Jobs and Workloads of kueue look like, for an error."""
        jobs = {job["metadata"]["name"]: (job["spec"].get("suspend"), job["status"]) for job in self.list_jobs()}
        path = f"/apis/kueue.x-k8s.io/v1beta2/namespaces/{self.tenant.namespace}/workloads"
        workloads = {
            item["metadata"]["name"]: item.get("status", {}).get("conditions")
            for item in self.cp.api.get(path)["items"]
        }
        return f"jobs {jobs}; workloads {workloads}"


def count_writes(cp: ControlPlane, namespace: str) -> dict[str, int]:
    """Returns how often the operator and kueue wrote Jobs of a namespace, by verb, without their status."""
    users = {
        service_account(OPERATOR_ACCOUNT).user: "operator",
        manager.list_identities()[manager.IDENTITY].user: "kueue",
    }
    writes = Counter(
        f"{users[record['user']['username']]} {record['verb']}"
        for record in audit.writes(cp.audit(), resource="jobs")
        if record["user"]["username"] in users
        and record["objectRef"].get("namespace") == namespace
        and not record["objectRef"].get("subresource")
    )
    return dict(sorted(writes.items()))


def play(shapes: Sequence[str], *, drained: Sequence[bool]) -> list[Outcome]:
    """Starts a control plane with kueue, our operator and our scheduler, and plays each story in a namespace of its own."""
    outcomes: list[Outcome] = []
    nodes = topology.Topology([topology.edge(f"queue-{number}") for number in range(3)])
    with ControlPlane(audit=True, identities=manager.list_identities()) as cp:
        product.install(cp)
        topology.apply(cp, nodes)
        manager.start(cp)
        say("kueue is ready")
        product.start_operator(cp, sweep_seconds=1, no_leader_election=True)
        product.start_scheduler(cp, sweep_seconds=1)
        for shape in shapes:
            for is_drained in drained:
                outcome = Outcome(shape, is_drained)
                outcomes.append(outcome)
                with created(cp, f"queue-{shape}-{len(outcomes)}") as namespace, pool(cp, namespace) as pool_name:
                    cp.kubectl("apply", "--server-side", "-f", "-", stdin=make_queue(namespace))
                    try:
                        Story(cp, namespace, outcome).run(pool_name)
                    except AssertionError as problem:
                        outcome.problems.append(str(problem))
                say(describe(outcome))
        if cp.api.get(CLAIMS)["items"]:
            outcomes[-1].problems.append("claims are left")
    return outcomes


def describe(outcome: Outcome) -> str:
    """Returns one line of an outcome."""
    addition = ", drained on the way" if outcome.is_drained else ""
    writes = ", ".join(f"{count} x {write}" for write, count in outcome.writes.items())
    problems = "".join(f"; NOT HELD: {problem}" for problem in outcome.problems)
    return (
        f"{outcome.shape}{addition}: {JOBS} Jobs of {CPUS} CPU, at most {outcome.most_at_once} at once, all done after"
        f" {outcome.seconds:.0f} s with {outcome.pods} pods; writes of Jobs: {writes}{problems}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Returns 1 when something did not hold."""
    parser = argparse.ArgumentParser(
        prog="scripts/bench kueue", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shape", choices=SHAPES, help="Jobs of a sweep, or components of one app; else both")
    parser.add_argument("--json", type=options.report, help="file for the figures")
    arguments = parser.parse_args(argv)
    say(f"kueue {kueue_binary.VERSION}")
    outcomes = play([arguments.shape] if arguments.shape else SHAPES, drained=(False, True))
    save(arguments.json, {"kueue": kueue_binary.VERSION, "outcomes": [asdict(outcome) for outcome in outcomes]})
    for outcome in outcomes:
        print(describe(outcome))
    return 1 if any(outcome.problems for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
