"""The closing summary tells the truth about every group, whichever failed."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from suite.summary import GroupResult, format_closing_line, format_summary, read_result

GOOD = GroupResult("tests/unit", Counter(passed=3, skipped=1), (), 2.5)
BAD = GroupResult("tests/live/chart", Counter(passed=1, failed=1, error=1), ("a.py::test_x", "b.py::test_y"), 70.25)
CUT_OFF = GroupResult("tests/crash", Counter())

SUITE = """
import pytest

@pytest.fixture
def breaks_afterwards():
    yield
    raise RuntimeError

def test_good(): pass
def test_bad_afterwards(breaks_afterwards): pass
def test_bad_twice(breaks_afterwards): assert 0
@pytest.mark.skipif(True, reason="no")
def test_left_out(): pass
class TestOf:
    @pytest.mark.parametrize("way", ["x/y", "b c: 1"])
    def test_bad(self, way): assert way == "x/y"
"""


def run_pytest(folder: Path, name: str, text: str) -> Path:
    report = folder / f"{name}.xml"
    (folder / f"test_{name}.py").write_text(text)
    command = ["-m", "pytest", "-q", f"--junitxml={report}", f"test_{name}.py"]
    (folder / "pytest.ini").write_text("[pytest]\njunit_family = xunit1\n")
    bare = {"PATH": os.environ["PATH"], "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}  # our plugins would cost seconds
    subprocess.run([sys.executable, *command], cwd=folder, env=bare, check=False, capture_output=True)
    return report


def test_a_real_report_is_read_with_the_ids_that_pytest_takes(tmp_path: Path) -> None:
    result = read_result("a", run_pytest(tmp_path, "a", SUITE))
    assert result.counts == {"passed": 2, "failed": 2, "error": 1, "skipped": 1}
    assert result.bad == (
        "test_a.py::test_bad_afterwards",
        "test_a.py::test_bad_twice",
        "test_a.py::TestOf::test_bad[b c: 1]",
    )
    assert result.seconds is not None


@pytest.mark.parametrize("content", [None, "", "<testsuites>", "<testsuites/>"])
def test_a_group_without_a_whole_report_did_not_finish(tmp_path: Path, content: str | None) -> None:
    report = tmp_path / "report.xml"
    if content is not None:
        report.write_text(content)
    assert read_result("a", report) == GroupResult("a", Counter())


def test_the_last_line_counts_all_groups_though_an_earlier_one_failed() -> None:
    *table, last = format_summary([BAD, GOOD])
    assert last == format_closing_line([BAD, GOOD])
    assert last.strip("=") == " 1 failed, 4 passed, 1 skipped, 1 error in 72.75s (0:01:12) "
    assert table[1:] == [
        "tests/live/chart       1       2        0     70.2",
        "tests/unit             3       0        1      2.5",
        "FAILED a.py::test_x",
        "FAILED b.py::test_y",
    ]


def test_a_group_that_did_not_finish_is_an_error() -> None:
    assert format_closing_line([GOOD, CUT_OFF]).strip("=") == " 3 passed, 1 skipped, 1 error in 2.50s "
    assert format_closing_line([CUT_OFF, BAD]).strip("=") == " 1 failed, 1 passed, 2 errors in 70.25s (0:01:10) "
    assert list(format_summary([CUT_OFF]))[1] == "tests/crash  did not finish"


def test_a_group_that_found_no_tests_is_an_error() -> None:
    empty = GroupResult("tests/new", Counter(), (), 0.5)
    assert "tests/new   found no tests" in list(format_summary([GOOD, empty]))
    assert format_closing_line([GOOD, empty]).strip("=") == " 3 passed, 1 skipped, 1 error in 3.00s "


@pytest.mark.parametrize(("text", "status"), [("def test_x(): pass", 0), ("def test_x(): assert 0", 1), ("", 1)])
def test_a_group_succeeds_only_when_everything_passed(tmp_path: Path, text: str, status: int) -> None:
    report = run_pytest(tmp_path, "c", text)
    result = read_result("tests/c", report)
    assert result.succeeded == (status == 0)
    assert list(format_summary([result]))[-1] == format_closing_line([result])
    assert not read_result("never", tmp_path / "no.xml").succeeded
