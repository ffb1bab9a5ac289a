"""Outages of a robot: the link to its partner is cut, or its node is offline for the cluster and for everybody."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from campaigns.reference.catalogue import Fault
from campaigns.reference.running_app import RunningApp
from campaigns.reference.trials.trial import Outage, Trial


def make_outage(
    app: RunningApp,
    trial: Trial,
    fault: Fault,
    *,
    robot: str,
    partner: str,
    meanwhile: Callable[[float], None] = lambda _began_s: None,
) -> Outage:
    """Keeps two components apart for as long as the trial says. `meanwhile` gets the time when that began, and takes part of it."""
    began_s = time.time()
    with _keep_apart(app, trial, fault, robot, partner):
        meanwhile(began_s)
        trial.outlast(began_s)
    return Outage(began_s, time.time())


def _keep_apart(app: RunningApp, trial: Trial, fault: Fault, robot: str, partner: str) -> AbstractContextManager[None]:
    if fault is Fault.LINK_CUT:
        return app.cut_link(trial.nodes[robot], trial.nodes[partner])
    if fault is Fault.ROBOT_OFFLINE:
        return app.take_offline(trial.nodes[robot])
    raise ValueError(f"{fault} is no outage of a robot")
