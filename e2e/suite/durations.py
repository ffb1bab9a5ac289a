"""Keeps the measured durations of live tests in the repository: parts are balanced by them.

`scripts/test --all --record` renews them from the reports of its run.
"""

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from suite.summary import find_test_id

FILE: Final = Path(__file__).with_name("durations.json")


def load_durations() -> dict[str, float]:
    """Returns seconds per module and per essential entry, as they were last recorded."""
    if not FILE.is_file():
        return {}
    return {name: float(seconds) for name, seconds in json.loads(FILE.read_text()).items()}


def read_reports(reports: Iterable[Path], entries: Iterable[str]) -> dict[str, float]:
    """Returns seconds per module, and per entry of tests/essential.txt, from JUnit reports (setup and teardown included)."""
    entry_list = list(entries)
    seconds: dict[str, float] = defaultdict(float)
    for report in reports:
        try:
            root = ET.parse(report).getroot()  # noqa: S314 - written by our own pytest
        except (OSError, ET.ParseError):  # its process was killed: the summary tells that
            continue
        for case in root.iter("testcase"):
            test_id, duration = find_test_id(case), float(case.get("time", 0))
            module = test_id.partition("::")[0]
            seconds[module] += duration
            for entry in entry_list:
                if entry != module and (test_id == entry or test_id.startswith((f"{entry}[", f"{entry}::"))):
                    seconds[entry] += duration
    return dict(seconds)


def save_durations(measured: Mapping[str, float], known_names: Iterable[str]) -> None:
    """Writes the durations, newer ones over older ones; names that no longer exist are dropped."""
    names = set(known_names)
    seconds_by_name = {**load_durations(), **measured}
    content = {name: round(seconds, 1) for name, seconds in sorted(seconds_by_name.items()) if name in names}
    FILE.write_text(json.dumps(content, indent=1) + "\n")
