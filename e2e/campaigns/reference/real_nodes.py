"""A cluster of real nodes for one scenario, and trials of its applications on it."""

import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from campaigns.nodes.claims import wait_published
from campaigns.reference.catalogue import ROBOT, SENSOR, Scenario
from campaigns.reference.running_app import RunningApp
from campaigns.reference.trials import CUT_S, Trial, play
from campaigns.scenarios.contenders import OURS, Contender
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real import RealNodes

MEASURES_EVERY_S = 2


@contextmanager
def start_cluster(scenario: Scenario, generations: Sequence[int]) -> Iterator[RealNodes]:
    """Starts the scenario's nodes with everything that the chart installs as pods, and waits until links are measured."""
    images = (*map(scenario.app, generations), *components_as_pods.IMAGES)
    with RealNodes(
        scenario.nodes, delays=scenario.delays, images=images, kube_scheduler=True, cdi=scenario.has_driver
    ) as cp:
        driver = {"driver": {"enabled": True}} if scenario.has_driver else {}
        components_as_pods.run(cp, values={"agent": {"intervalSeconds": MEASURES_EVERY_S, **driver}})
        components_as_pods.wait_measured(cp)
        if scenario.has_driver and not wait_published(cp, ROBOT, SENSOR.id):
            raise TestbedError(f"{ROBOT} does not publish its sensor, see {cp.logs_dir}")
        yield cp


def run_trial(
    cp: RealNodes, scenario: Scenario, ros: int, contender: Contender = OURS, *, outage_s: float | None = None
) -> Trial:
    """Plays one application in a namespace of its own, which enforces `restricted` where the app keeps to that."""
    name = scenario.app(ros)
    trial = Trial(name, contender.name, scenario.fault, outage_s=CUT_S if outage_s is None else outage_s)
    with created(cp, f"{name}-{secrets.token_hex(3)}") as namespace:
        if scenario.has_driver:
            cp.kubectl("label", "namespace", namespace, "pod-security.kubernetes.io/enforce=restricted")
        play(RunningApp(cp, namespace, scenario, name, scheduler=contender.scheduler_name), trial)
        # Its places must be free before the next one comes.
        cp.kubectl("delete", "robotapp", name, "-n", namespace, "--cascade=foreground", "--timeout=60s", check=False)
    return trial


def describe(trial: Trial) -> str:
    """Returns one line of where the application was and what it did."""
    nodes = ", ".join(f"{component} on {node}" for component, node in sorted(trial.nodes.items()))
    figures = ", ".join(f"{name} {value:.3g}" for name, value in trial.figures.items())
    broken = f"; NOT KEPT: {trial.broken}" if trial.broken else ""
    return f"{trial.app} under {trial.scheduler}: {nodes}; {figures}{broken}"
