"""Detection: nine of ten signs are found, by the next detector too, and again when the camera is back."""

import csv
import time
from typing import Final

from campaigns.nodes.real_pods import shell
from campaigns.reference.catalogue import Fault
from campaigns.reference.running_app import STARTED_S, RunningApp
from campaigns.reference.trials.outages import make_outage
from campaigns.reference.trials.trial import Trial

PICTURES: Final = 20
RECALL: Final = 0.9
Row = dict[str, str]


def try_detection(app: RunningApp, trial: Trial, fault: Fault) -> None:
    rows = wait_for_pictures(app, within_s=STARTED_S)
    trial.nodes = app.list_nodes()
    trial.figures |= {
        "recall": find_recall(rows),
        "detect_ms": sum(float(row["detect_ms"]) for row in rows) / len(rows),
    }
    if fault in (Fault.POD_KILLED, Fault.MASTER_KILLED):
        ended_s = time.time()
        if fault is Fault.POD_KILLED:
            app.kill_pod("detector")
        else:
            app.replace_master(("camera", "detector"))
        rows = wait_for_pictures(app, within_s=STARTED_S)
    else:
        detector_uid = app.uid_of("detector")
        ended_s = make_outage(app, trial, fault, robot="camera", partner="detector").ended_s
        rows = wait_for_pictures(app, after_s=ended_s, within_s=STARTED_S + trial.heals_within_s)
        trial.demand(app.uid_of("detector") == detector_uid, "the detector's pod stays")
    trial.figures["recall_after"] = find_recall(rows)
    trial.figures["next_picture_after_s"] = float(rows[0]["stamp"]) - ended_s
    for name in ("recall", "recall_after"):
        trial.demand(trial.figures[name] >= RECALL, f"{name} is at least {RECALL}, not {trial.figures[name]:.3f}")
    trial.demand(trial.figures["next_picture_after_s"] > 0, "the next detector begins with a later picture")


def wait_for_pictures(app: RunningApp, *, within_s: float, after_s: float = 0.0) -> list[Row]:
    """Waits until the detector has worked on enough pictures that were taken after a time, and returns those."""

    def list_later() -> list[Row]:
        return [row for row in read_pictures(app) if float(row["stamp"]) > after_s]

    app.wait_until(
        lambda: len(list_later()) >= PICTURES,
        what=f"{PICTURES} pictures are worked on",
        component="detector",
        within_s=within_s,
    )
    return list_later()


def read_pictures(app: RunningApp) -> list[Row]:
    """Returns the rows of the detector's own table, [] while it has none."""
    pod = app.list_pods().get("detector")
    if pod is None:
        return []
    name = pod["metadata"]["name"]
    text = shell(app.cp, app.namespace, name, "cat /results/detections.csv 2>/dev/null", check=False)
    return [row for row in csv.DictReader(text.splitlines()) if row.get("hits")] if text.startswith("stamp") else []


def find_recall(rows: list[Row]) -> float:
    return sum(int(row["hits"]) for row in rows) / sum(int(row["signs"]) for row in rows)
