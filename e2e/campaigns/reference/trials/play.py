"""Applies an application, lets it work, makes a fault and waits for what its README promises."""

import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Final

from campaigns.reference.catalogue import Fault
from campaigns.reference.running_app import BrokenPromiseError, RunningApp
from campaigns.reference.trials.detection import try_detection
from campaigns.reference.trials.fleet import try_fleet
from campaigns.reference.trials.navigation import try_navigation
from campaigns.reference.trials.teleop import try_teleop
from campaigns.reference.trials.trial import Trial
from campaigns.reference.trials.usb_sensor import try_usb_sensor

TRIALS: Final[Mapping[str, Callable[[RunningApp, Trial, Fault], None]]] = {
    "teleop": try_teleop,
    "navigation": try_navigation,
    "usb-sensor": try_usb_sensor,
    "fleet": try_fleet,
    "detection": try_detection,
}
"""By scenario."""


def play(app: RunningApp, trial: Trial, fault: Fault) -> None:
    """Plays one fault; the outcome is in the trial."""
    trial.began_at = datetime.now(UTC).isoformat(timespec="seconds")
    began_s = time.monotonic()
    try:
        app.apply()
        TRIALS[app.scenario.name](app, trial, fault)
    except BrokenPromiseError as problem:
        trial.broken = trial.broken or str(problem)
    trial.took_s = round(time.monotonic() - began_s, 1)
