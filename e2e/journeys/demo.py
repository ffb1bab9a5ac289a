"""`scripts/demo`: the whole story on a real control plane, every claim checked on the way.

Without --once the cluster stays up: a holder process in its own session tells the story on this terminal and then keeps
the cluster, so closing the terminal does not end it and `scripts/demo --down` does.
"""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

from journeys.burst import survive_kills
from journeys.comparison import compare_with_kube_scheduler
from journeys.demo_cluster import NAMESPACE, NAMESPACES, ROOT, DemoCluster
from journeys.stage import FalseClaimError, Stage
from journeys.steps import apply_teleop, explain_teleop, open_console, render_from_rigel, share_a_can_bus
from robotapp_testbed import ControlPlane, TestbedError
from robotapp_testbed.browser import start_console
from robotapp_testbed.control_plane import guest, product
from robotapp_testbed.control_plane.guest import GuestPlane
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import Device, Tier
from robotapp_testbed.machines.topology import SimulatedTelemetry, apply, fleet
from robotapp_testbed.processes.detached import Cluster
from robotapp_testbed.processes.process import wait_until

STORY: tuple[Callable[[Stage, DemoCluster], None], ...] = (
    apply_teleop,
    explain_teleop,
    compare_with_kube_scheduler,
    share_a_can_bus,
    survive_kills,
    render_from_rigel,
    open_console,
)
EXAMPLES = """examples:
  scripts/demo            tell the story, then leave the cluster up to play with
  scripts/demo --once     tell the story, tear down; exit status 1 on the first false claim
  scripts/demo --down     end the cluster that an earlier run left up
  scripts/demo --once --kubeconfig ~/.kube/kind
                          the same on a cluster of your own, which is left as it was
"""
_LOADS: Final[Mapping[Tier, Mapping[str, int]]] = {
    Tier.ROBOT: {"cpu": 38, "memory": 52},
    Tier.EDGE: {"cpu": 24, "memory": 31},
    Tier.CLOUD: {"cpu": 9, "memory": 17},
}
"""What the simulated agents report, in percent."""
_CLUSTER = Cluster("demo")
_STORY_LIMIT_S = 900.0
_DOWN_LIMIT_S = 180.0
"""A guest removes its namespaces from the user's cluster, which takes as long as that cluster likes."""
_INTERRUPTED = "\nEnded; nothing is left running."


def main() -> int:
    arguments = _arguments()
    try:
        if arguments.down:
            return _down(arguments.kubeconfig)
        if arguments.once or arguments.hold:
            return _tell(hold=arguments.hold, picture=arguments.svg, kubeconfig=arguments.kubeconfig)
        return _start_holder(arguments.kubeconfig)
    except TestbedError as failure:
        print(f"The demo cannot run: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:  # also what --down makes of a story that is being told
        print(_INTERRUPTED)
        return 130


def _down(kubeconfig: Path | None) -> int:
    ended = _CLUSTER.down(within_s=_DOWN_LIMIT_S)
    if kubeconfig:  # a demo that was killed could not clean up there
        ended = guest.remove(kubeconfig, namespaces=NAMESPACES) or ended
    print("The demo is gone." if ended else "No demo is running.")
    return 0


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
    parser.add_argument(
        "--kubeconfig",
        metavar="FILE",
        type=Path,
        help="tell the story on your own cluster (kind, k3s …), on simulated nodes that are added and removed again",
    )
    parser.add_argument("--svg", type=Path, help="with --once: save what was shown as a picture")
    mode.add_argument("--hold", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


def _tell(*, hold: bool, picture: Path | None = None, kubeconfig: Path | None = None) -> int:
    """Tell the story; 1 when a claim was false or something could not start."""
    stage = Stage()
    plane = _plane(kubeconfig)
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


def _plane(kubeconfig: Path | None) -> ControlPlane:
    if kubeconfig:
        return GuestPlane(kubeconfig, nodes=build_topology().nodes, namespaces=NAMESPACES)
    return ControlPlane(kube_scheduler=True)


def build_topology(*, guests: bool = False) -> Topology:
    """Two robots, one of them with a CAN bus, two edge servers, one cloud machine. `guests` keep everybody else off."""
    can = Device(id="can-can0", type="can", interface="can0")
    nodes = fleet(robots=["amr-07", "amr-08"], edges=2, clouds=1, devices={"amr-07": [can]})
    if not guests:
        return nodes
    return Topology(replace(node, taints=[guest.TAINT], labels={guest.GUEST_LABEL: "true"}) for node in nodes)


def _tell_on(stage: Stage, cluster: ControlPlane, stack: ExitStack) -> DemoCluster:
    demo = set_up(stage, cluster, stack)
    for step in STORY:
        step(stage, demo)
    stage.close()
    return demo


def _tell_and_stay(stage: Stage, cluster: ControlPlane, stack: ExitStack) -> None:
    how_to_go_on(stage, _tell_on(stage, cluster, stack))
    _leave_terminal()


def set_up(stage: Stage, cluster: ControlPlane, stack: ExitStack, topology: Topology | None = None) -> DemoCluster:
    """Makes the nodes, by default those of the story, and runs operator and scheduler with their pods' rights."""
    confined = isinstance(cluster, GuestPlane)
    if confined:
        stage.say(f"A guest in your cluster {cluster.server_url}: everything added is removed at the end.")
        stage.say("Each application gets a toleration and a node selector that keep it on the simulated nodes.")
    else:
        stage.say(f"A real control plane runs: {cluster.server_url} (etcd, kube-apiserver, controllers, scheduler).")
    if topology is None:
        stage.say("Nodes: 2 robots, 2 edge servers, 1 cloud machine.")
    stage.say(
        "[yellow]Simulated[/yellow]: the kubelets (by kwok) and the telemetry (round trips of 2, 15 and 60 ms, load)."
    )
    with stage.working("installing CRDs, rights and policies"):
        # Its nodes are simulated, and so is what an agent would measure.
        values = {"agent": {"enabled": False}, "domainPool": {"quarantineSeconds": 1}}
        product.install(cluster, values=values)
    topology = topology or build_topology(guests=confined)
    apply(cluster, topology)
    telemetry = stack.enter_context(SimulatedTelemetry(cluster, topology))
    for node in topology:
        telemetry.set_load(node.name, **_LOADS[node.tier])
    cluster.kubectl("create", "namespace", NAMESPACE)
    with stage.working("starting operator, scheduler and console"):
        operator = product.start_operator(cluster, wait=False, sweep_seconds=1)
        scheduler = product.start_scheduler(
            cluster,
            wait=False,
            sweep_seconds=1,
            insecure_explain=True,
            config_map=product.SCHEDULER_CONFIG,
            last_good_config_map=product.LAST_GOOD_CONFIG,
        )
        operator.wait_ready()
        scheduler.wait_ready()
        console = start_console(cluster, scheduler_url=scheduler.health_url)
    return DemoCluster(
        cluster=cluster,
        operator=operator,
        scheduler=scheduler,
        topology=topology,
        telemetry=telemetry,
        console=console,
        confined=confined,
    )


def how_to_go_on(stage: Stage, demo: DemoCluster) -> None:
    """Lines to paste: our kubectl comes last on the PATH, for those who have none; the scheduler is no pod to be found."""
    cluster = demo.cluster
    stage.say("\nThe cluster stays up. To play with it, paste:")
    stage.say(f"  export KUBECONFIG={cluster.kubeconfig()} ROBOTAPP_SCHEDULER_URL={demo.scheduler.health_url}")
    stage.say(f"  export PATH={ROOT / '.venv/bin'}:$PATH:{cluster.run_dir / 'bin'}")
    stage.say(f"  kubectl get ra -n {NAMESPACE};  kubectl robotapp info teleop -n {NAMESPACE}")
    stage.say(f"  kubectl robotapp explain teleop -n {NAMESPACE} -o wide;  kubectl explain robotapp.spec")
    stage.say(f"The console, once (kubectl robotapp console opens another one):  {demo.console.address}")
    stage.say("and end it with  scripts/demo --down")


def _leave_terminal() -> None:
    """The story is told; whatever is said from now on belongs to the log, not to the user's terminal."""
    _CLUSTER.log_path.parent.mkdir(parents=True, exist_ok=True)
    log = os.open(_CLUSTER.log_path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    for descriptor in (sys.stdout.fileno(), sys.stderr.fileno()):
        os.dup2(log, descriptor)
    os.close(log)


def _start_holder(kubeconfig: Path | None) -> int:
    """Run the story in a process of its own session and return once it holds the cluster or has ended."""
    if _CLUSTER.state():
        print("The demo's cluster is still up from an earlier run: scripts/demo --down ends it.")
        return 1
    _plane(kubeconfig).get_binaries()  # here, so that an interrupt finds no holder to end
    own = [f"--kubeconfig={kubeconfig.absolute()}"] if kubeconfig else []
    holder = subprocess.Popen([sys.executable, "-m", "journeys.demo", "--hold", *own], start_new_session=True)
    try:
        wait_until(lambda: holder.poll() is not None or _CLUSTER.state() is not None, timeout_s=_STORY_LIMIT_S)
    except KeyboardInterrupt:
        holder.send_signal(signal.SIGKILL)  # the testbed's guard cleans up after it
        print(_INTERRUPTED)
        return 130
    holder.returncode = holder.poll() or 0  # it is meant to go on without us
    return holder.returncode


if __name__ == "__main__":
    sys.exit(main())
