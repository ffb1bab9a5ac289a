"""detection-ros1 with a real roscore and detection-ros2 over real DDS: the detector finds at least nine of ten signs, and a new one goes on with the next picture."""

import csv
import logging
from collections.abc import Callable

import pytest
from tests.live.reference.programs import Programs
from tests.support.work_unit import slowness

from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

PARAMETERS = "--ros-args --params-file /ws/install/share/reference_detection/config/detection.yaml"
CAMERA, DETECTOR = (
    {
        "detection-ros1": f"roslaunch --wait reference_detection {node}.launch",
        "detection-ros2": f"ros2 run reference_detection {node} {PARAMETERS}",
    }
    for node in ("camera", "detector")
)
APPS = sorted(CAMERA)
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
STARTED_S = 60.0
PICTURES = 30
RECALL = 0.9


def read_rows(programs: Programs) -> list[dict[str, str]]:
    """Returns the pictures that the running detector has worked on."""
    path = programs.root / "results" / "detections.csv"
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("app", APPS)
def test_nine_of_ten_signs_are_found_and_the_next_detector_goes_on(
    app: str, run_app: Callable[[str], Programs]
) -> None:
    programs = run_app(app)
    programs.start("camera", CAMERA[app])
    programs.start("detector", DETECTOR[app], ONE_THREAD)
    assert wait_until(lambda: len(read_rows(programs)) >= PICTURES, timeout_s=STARTED_S * slowness())
    rows = read_rows(programs)
    recall = sum(int(row["hits"]) for row in rows) / sum(int(row["signs"]) for row in rows)
    mean_ms = sum(float(row["detect_ms"]) for row in rows) / len(rows)
    logger.info("%d pictures, recall %.3f, %.0f ms each", len(rows), recall, mean_ms)
    assert recall >= RECALL
    programs.kill("detector")
    programs.start("detector", DETECTOR[app], ONE_THREAD)
    assert wait_until(lambda: 0 < len(read_rows(programs)) < PICTURES, timeout_s=STARTED_S * slowness())
    assert float(read_rows(programs)[0]["stamp"]) > float(rows[-1]["stamp"])
