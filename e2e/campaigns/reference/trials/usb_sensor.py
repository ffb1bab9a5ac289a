"""The USB sensor: readings arrive from another node, and arrive again after the sensor was unplugged."""

import re
import time
from typing import Final

from campaigns.nodes.real_pods import shell
from campaigns.reference.catalogue import SENSOR, Fault
from campaigns.reference.running_app import STARTED_S, RunningApp
from campaigns.reference.trials.trial import Trial

NOTICED_S: Final = 20.0
BACK_S: Final = 40.0


def try_usb_sensor(app: RunningApp, trial: Trial, fault: Fault) -> None:
    trial.demand(fault is Fault.SENSOR_UNPLUGGED, f"nothing is promised for {fault}")
    app.wait_for("driver", "connected to /dev/sensor", within_s=STARTED_S)
    first_s = app.wait_for("listener", "readings, the last", within_s=STARTED_S)
    trial.figures["readings_after_s"] = first_s - app.applied_s
    trial.nodes = app.list_nodes()
    uids = {component: app.uid_of(component) for component in ("driver", "listener")}
    driver = app.list_pods()["driver"]["metadata"]["name"]
    trial.demand(shell(app.cp, app.namespace, driver, "id -u") == "65532\n", "the driver runs without privileges")
    back_s = _unplug(app, trial)
    again_s = app.wait_for("listener", "readings are back after", within_s=BACK_S, after_s=back_s)
    trial.figures["readings_again_after_s"] = again_s - back_s
    # The pod may have found the sensor again by itself; it is replaced all the same, because the file may mean another one.
    trial.demand(not trial.broken, trial.broken)
    app.wait_until(
        lambda: app.uid_of("driver") not in ("", uids["driver"]),
        what="the driver's pod is replaced",
        component="driver",
        within_s=BACK_S,
    )
    trial.figures["new_pod_has_it_after_s"] = (
        app.wait_for("driver", "connected to /dev/sensor", within_s=BACK_S, after_s=back_s) - back_s
    )
    count = _count_readings(app)
    app.wait_until(lambda: _count_readings(app) > count, what="readings go on", component="listener", within_s=BACK_S)
    trial.demand(app.uid_of("listener") == uids["listener"], "the listener's pod stays")
    trial.demand(app.count_restarts() == 0, "no container is started again")


def _count_readings(app: RunningApp) -> int:
    summaries = re.findall(r"(\d+) readings, the last", app.read_log("listener"))
    return int(summaries[-1]) if summaries else 0


def _unplug(app: RunningApp, trial: Trial) -> float:
    """Takes the sensor away until its loss counts, and puts it back. Returns when that was: what is printed before concerns another gap.

    Whether its loss is in the app's status is noted, because only our scheduler's pods are replaced for it: readings are measured
    under either.
    """
    devices = app.cp.node(trial.nodes["driver"]).devices
    unplugged_s = time.time()
    devices.unplug(SENSOR.id)
    try:
        app.wait_for("driver", "was unplugged after", within_s=NOTICED_S, after_s=unplugged_s)
        app.wait_for("driver", "no device at /dev/sensor", within_s=NOTICED_S, after_s=unplugged_s)
        app.wait_for("listener", "no readings for 2 s", within_s=NOTICED_S, after_s=unplugged_s)
        with trial.noting():
            app.wait_until(
                lambda: app.read_reason("Allocated") == "DeviceLost",
                what="the condition Allocated has the reason DeviceLost",
                component="driver",
                within_s=NOTICED_S,
            )
        trial.outlast(time.time())
    finally:
        back_s = time.time()
        devices.plug(SENSOR.id)
    return back_s
