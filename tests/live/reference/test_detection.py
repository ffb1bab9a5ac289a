"""detection-ros2 over real DDS: the detector finds at least nine of ten signs, and a new one goes on with the next picture."""

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
CAMERA = f"ros2 run reference_detection camera {PARAMETERS}"
DETECTOR = f"ros2 run reference_detection detector {PARAMETERS}"
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


def test_nine_of_ten_signs_are_found_and_the_next_detector_goes_on(run_app: Callable[[str], Programs]) -> None:
    programs = run_app("detection-ros2")
    programs.start("camera", CAMERA)
    programs.start("detector", DETECTOR, ONE_THREAD)
    assert wait_until(lambda: len(read_rows(programs)) >= PICTURES, timeout_s=STARTED_S * slowness())
    rows = read_rows(programs)
    recall = sum(int(row["hits"]) for row in rows) / sum(int(row["signs"]) for row in rows)
    mean_ms = sum(float(row["detect_ms"]) for row in rows) / len(rows)
    logger.info("%d pictures, recall %.3f, %.0f ms each", len(rows), recall, mean_ms)
    assert recall >= RECALL
    programs.kill("detector")
    programs.start("detector", DETECTOR, ONE_THREAD)
    assert wait_until(lambda: 0 < len(read_rows(programs)) < PICTURES, timeout_s=STARTED_S * slowness())
    assert float(read_rows(programs)[0]["stamp"]) > float(rows[-1]["stamp"])
