"""`scripts/bench versions`: what is run exists, and the result is told with its failures."""

from typing import Any

import pytest

from campaigns.versions.versions import SMOKE, told
from robotapp_testbed.binaries import pins

RESULT: dict[str, Any] = {"version": "v1.35.4", "demo": True, "demo_s": 50.2, "passed": 9, "bad": [], "smoke_s": 99.9}


@pytest.mark.parametrize("file", SMOKE)
def test_every_file_of_the_smoke_suite_exists(file: str) -> None:
    assert (pins.REPOSITORY / file).is_file()


def test_a_result_is_told_in_one_sentence_with_the_names_of_what_failed() -> None:
    assert told(RESULT) == "Kubernetes v1.35.4: the demo passed in 50 s, 9 smoke tests passed and 0 failed in 100 s"
    worse = told(RESULT | {"demo": False, "bad": ["tests/a.py::test_b"]})
    assert "THE DEMO FAILED" in worse
    assert worse.endswith("1 failed in 100 s: tests/a.py::test_b")
