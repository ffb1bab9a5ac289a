"""A plugin of pytest that writes the ids of failed tests, one a line, into the file that REPORT names."""

import os
from pathlib import Path
from typing import Final

import pytest

REPORT: Final = "ROBOTAPP_MUTANTS_REPORT"


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed:
        _note(report.nodeid)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if report.failed:
        _note(report.nodeid)


def _note(test: str) -> None:
    """Appends the id; processes of pytest-xdist hand theirs to the one that started them."""
    if "PYTEST_XDIST_WORKER" not in os.environ and (file := os.environ.get(REPORT)):
        with Path(file).open("a", encoding="utf-8") as lines:
            lines.write(f"{test}\n")
