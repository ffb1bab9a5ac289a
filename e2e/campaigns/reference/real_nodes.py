"""A cluster of real nodes for some or all scenarios, and trials of their applications on it."""

import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from campaigns.nodes.claims import wait_published
from campaigns.reference.catalogue import OUTAGES_S, ROBOT, SENSOR, Fault, Scenario, list_delays, merge_nodes
from campaigns.reference.placement import list_promises, make_topology
from campaigns.reference.robotapps import read_app
from campaigns.reference.running_app import RunningApp
from campaigns.reference.trials.play import play
from campaigns.reference.trials.trial import Trial
from campaigns.scenarios.contenders import OURS, Contender
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines.nodes import SimulatedNode
from robotapp_testbed.real import RealNodes

MEASURES_EVERY_S = 2


@contextmanager
def start_cluster(scenarios: Sequence[Scenario], others: Sequence[SimulatedNode] = ()) -> Iterator[RealNodes]:
    """Starts the nodes of scenarios, and others, with everything that the chart installs as pods, and waits until links are measured.

    Images of applications come with their first trial.
    """
    nodes = merge_nodes(scenarios, others)
    has_driver = any(scenario.has_driver for scenario in scenarios)
    delays = list_delays([node.name for node in nodes])
    with RealNodes(nodes, delays=delays, images=components_as_pods.IMAGES, kube_scheduler=True, cdi=has_driver) as cp:
        driver = {"driver": {"enabled": True}} if has_driver else {}
        components_as_pods.run(cp, values={"agent": {"intervalSeconds": MEASURES_EVERY_S, **driver}})
        components_as_pods.wait_measured(cp)
        if has_driver and not wait_published(cp, ROBOT, SENSOR.id):
            raise TestbedError(f"{ROBOT} does not publish its sensor, see {cp.logs_dir}")
        yield cp


def run_trial(
    cp: RealNodes,
    scenario: Scenario,
    ros: int,
    contender: Contender = OURS,
    *,
    fault: Fault | None = None,
    outage_s: float | None = None,
) -> Trial:
    """Plays one fault, the application's own unless another is given, in a namespace which enforces `restricted` where the app keeps to it."""
    name, fault = scenario.app(ros), fault or scenario.faults[0]
    outage_s = OUTAGES_S.get(fault, 0.0) if outage_s is None else outage_s
    trial = Trial(name, contender.name, scenario.describe_fault(fault, outage_s), outage_s=outage_s)
    cp.import_image(name, scenario.list_hosts(cp.nodes))
    # A node that was offline in the trial before must be measured anew.
    cp.wait_nodes()
    components_as_pods.wait_measured(cp)
    with created(cp, f"{name}-{secrets.token_hex(3)}") as namespace:
        if scenario.has_driver:
            cp.kubectl("label", "namespace", namespace, "pod-security.kubernetes.io/enforce=restricted")
        app = RunningApp(cp, namespace, scenario, name, scheduler=contender.scheduler_name)
        play(app, trial, fault)
        trial.nodes = trial.nodes or app.list_nodes()
        trial.misplaced = list_misplaced(scenario, ros, trial)
        # Its places must be free before the next one comes.
        cp.kubectl("delete", "robotapp", name, "-n", namespace, "--cascade=foreground", "--timeout=60s", check=False)
    return trial


def list_misplaced(scenario: Scenario, ros: int, trial: Trial) -> list[str]:
    """Returns what the RobotApp asks of its places and does not get from the trial's nodes."""
    app = read_app(scenario.app(ros), scenario.runs_on, use_images=False)
    promises = list_promises(scenario, app, trial.nodes, make_topology())
    return [promise for promise, is_kept in promises.items() if not is_kept]


def describe(trial: Trial) -> str:
    """Returns one line of where the application was and what it did."""
    nodes = ", ".join(f"{component} on {node}" for component, node in sorted(trial.nodes.items()))
    figures = ", ".join(f"{name} {value:.3g}" for name, value in trial.figures.items())
    misplaced = f"; MISPLACED: {', '.join(trial.misplaced)}" if trial.misplaced else ""
    broken = f"; NOT KEPT: {trial.broken}" if trial.broken else ""
    return f"{trial.app} under {trial.scheduler}, {trial.fault}: {nodes}; {figures}{misplaced}{broken} [{trial.took_s:.0f} s]"
