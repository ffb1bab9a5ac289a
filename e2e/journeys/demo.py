"""`scripts/demo`: the whole story on a real control plane, every claim checked on the way.

Without --once the cluster stays up: a holder process in its own session tells the story on this terminal and then keeps
the cluster, so closing the terminal does not end it and `scripts/demo --down` does.
"""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from journeys.burst import survive_kills
from journeys.comparison import compare_with_kube_scheduler
from journeys.stage import FalseClaimError, Stage
from journeys.steps import apply_teleop, explain_teleop, render_from_rigel, share_a_can_bus
from journeys.world import NAMESPACE, ROOT, World
from robotapp_testbed import ControlPlane, TestbedError, product
from robotapp_testbed.assets import Assets
from robotapp_testbed.detached import Cluster
from robotapp_testbed.nodes import Device
from robotapp_testbed.process import wait_until
from robotapp_testbed.topology import SimulatedTelemetry, apply, fleet

STORY: tuple[Callable[[Stage, World], None], ...] = (
    apply_teleop,
    explain_teleop,
    compare_with_kube_scheduler,
    share_a_can_bus,
    survive_kills,
    render_from_rigel,
)
EXAMPLES = """examples:
  scripts/demo            tell the story, then leave the cluster up to play with
  scripts/demo --once     tell the story, tear down; exit status 1 on the first false claim
  scripts/demo --down     end the cluster that an earlier run left up
"""
_CLUSTER = Cluster("demo")
_STORY_LIMIT_S = 900.0


def main() -> int:
    arguments = _arguments()
    if arguments.down:
        print("The demo's cluster is gone." if _CLUSTER.down() else "No demo cluster is running.")
        return 0
    if arguments.once:
        return _tell(hold=False, picture=arguments.svg)
    if arguments.hold:
        return _tell(hold=True)
    return _start_holder()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/demo",
        description="Shows RobotApp working on a real control plane.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--once", action="store_true", help="tear down at the end instead of leaving the cluster up")
    mode.add_argument("--down", action="store_true", help="end the cluster an earlier run left up")
    parser.add_argument("--svg", type=Path, help="with --once: save what was shown as a picture")
    mode.add_argument("--hold", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


def _tell(*, hold: bool, picture: Path | None = None) -> int:
    """Tell the story; 1 when a claim was false or something could not start."""
    stage = Stage()
    plane = ControlPlane(kube_scheduler=True)
    try:
        if hold:
            _CLUSTER.hold(plane, prepare=lambda cluster, stack: _tell_and_stay(stage, cluster, stack))
        else:
            with plane as cluster, ExitStack() as stack:
                _tell_on(stage, cluster, stack)
        if picture:
            stage.save_svg(picture)
    except (FalseClaimError, TestbedError) as failure:
        stage.say(f"\n[red]The demo stops here.[/red] {failure}")
        return 1
    return 0


def _tell_on(stage: Stage, cluster: ControlPlane, stack: ExitStack) -> None:
    world = _set_up(stage, cluster, stack)
    for step in STORY:
        step(stage, world)
    stage.close()


def _tell_and_stay(stage: Stage, cluster: ControlPlane, stack: ExitStack) -> None:
    _tell_on(stage, cluster, stack)
    _how_to_go_on(stage, cluster)
    _leave_terminal()


def _set_up(stage: Stage, cluster: ControlPlane, stack: ExitStack) -> World:
    """Two robots, two edge servers, one cloud machine; operator and scheduler as local processes with their pods' rights."""
    stage.say(f"A real control plane runs: {cluster.server_url} (etcd, kube-apiserver, controllers, kube-scheduler).")
    stage.say("Nodes: 2 robots, 2 edge servers, 1 cloud machine.")
    stage.say("[yellow]Simulated[/yellow]: the kubelets (by kwok) and the telemetry (round trips of 2, 15 and 60 ms).")
    product.install(cluster, values={"domainPool": {"quarantineSeconds": 1}})
    can = Device(id="can-can0", type="can", interface="can0")
    topology = fleet(robots=["amr-07", "amr-08"], edges=2, clouds=1, devices={"amr-07": [can]})
    apply(cluster, topology)
    stack.enter_context(SimulatedTelemetry(cluster, topology))
    cluster.kubectl("create", "namespace", NAMESPACE)
    with stage.working("starting operator and scheduler"):
        operator = product.start_operator(cluster, wait=False, sweep_seconds=1)
        scheduler = product.start_scheduler(cluster, wait=False, sweep_seconds=1, insecure_explain=True)
        operator.wait_ready()
        scheduler.wait_ready()
    return World(cluster=cluster, operator=operator, scheduler=scheduler, topology=topology)


def _how_to_go_on(stage: Stage, cluster: ControlPlane) -> None:
    stage.say("\nThe cluster stays up. To play with it, paste:")
    stage.say(f"  export KUBECONFIG={cluster.kubeconfig()} PATH={ROOT / '.venv/bin'}:$PATH")
    stage.say(
        f"  kubectl get ra -n {NAMESPACE};  kubectl robotapp info teleop -n {NAMESPACE};  kubectl explain robotapp.spec"
    )
    stage.say("and end it with  scripts/demo --down")


def _leave_terminal() -> None:
    """The story is told; whatever is said from now on belongs to the log, not to the user's terminal."""
    _CLUSTER.log_path.parent.mkdir(parents=True, exist_ok=True)
    log = os.open(_CLUSTER.log_path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    for descriptor in (sys.stdout.fileno(), sys.stderr.fileno()):
        os.dup2(log, descriptor)
    os.close(log)


def _start_holder() -> int:
    """Run the story in a process of its own session and return once it holds the cluster or has ended."""
    if _CLUSTER.state():
        print("The demo's cluster is still up from an earlier run: scripts/demo --down ends it.")
        return 1
    Assets().resolve()
    holder = subprocess.Popen([sys.executable, "-m", "journeys.demo", "--hold"], start_new_session=True)
    try:
        wait_until(lambda: holder.poll() is not None or _CLUSTER.state() is not None, timeout_s=_STORY_LIMIT_S)
    except KeyboardInterrupt:
        holder.send_signal(signal.SIGKILL)  # the testbed's guard cleans up after it
        print("\nEnded; nothing is left running.")
        return 130
    holder.returncode = holder.poll() or 0  # it is meant to go on without us
    return holder.returncode


if __name__ == "__main__":
    sys.exit(main())
