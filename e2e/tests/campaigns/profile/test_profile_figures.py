"""Figures of the profile bench: accuracy, calibration and the targets."""

import json
from dataclasses import replace
from pathlib import Path

from campaigns.profile.profile import Case, calibration_error, figures, folds, interval, labels, reliability

GOOD = Case("r/p", "o/r", "high", "realtime", "realtime", 0.95, ("serial",), ("serial",), 0.9, "robot", "robot")


def all_right() -> list[Case]:
    names = ("realtime", "sensor_data", "system_default", "best_effort")
    return [replace(GOOD, want_class=name, got_class=name) for name in names]


def test_an_abstention_and_a_missing_checkout_count_as_wrong() -> None:
    found = figures([*all_right(), replace(GOOD, got_class="", class_confidence=0.0, found=False)])
    assert (found["qos"], found["abstained"], found["not_found"]) == (0.8, 1, ["r/p"])
    assert found["failed"] == ["qos is 0.800, wanted 0.85"]


def test_a_realtime_package_called_best_effort_with_certainty_fails() -> None:
    cases = all_right() * 10
    assert figures([*cases, replace(GOOD, got_class="best_effort", class_confidence=0.7)])["failed"] == []
    assert "r/p" in figures([*cases, replace(GOOD, got_class="best_effort", class_confidence=0.8)])["failed"][0]


def test_the_calibration_error_is_the_distance_of_stated_and_seen() -> None:
    table = reliability([(0.9, True), (0.9, False), (0.5, True), (0.5, False)])
    assert [row["right"] for row in table] == [0.5, 0.5]
    assert calibration_error(table) == 0.2


def test_a_repository_is_in_one_fold_only() -> None:
    cases = [replace(GOOD, repo=f"o/{index % 7}") for index in range(30)]
    assert sum(fold["packages"] for fold in folds(cases)) == 30


def test_an_interval_holds_the_share_and_shrinks_with_the_number_of_packages() -> None:
    few, many = interval([True] * 8 + [False] * 2), interval([True] * 80 + [False] * 20)
    assert few == (0.4902, 0.9433)
    assert few[0] < many[0] < 0.8 < many[1] < few[1]
    assert interval([]) == (0.0, 1.0)


def test_one_half_of_the_labels_is_measured_alone(tmp_path: Path) -> None:
    row = {"repo": "o/r", "path": ".", "qos_class": "realtime", "hardware": []}
    rows = [{**row, "id": "r/a", "half": "mended"}, {**row, "id": "r/b", "half": "unseen"}, {**row, "id": "r/c"}]
    file = tmp_path / "labels.jsonl"
    file.write_text("".join(json.dumps(one) + "\n" for one in rows))
    assert [label.id for label in labels(file, "unseen")] == ["r/b"]
    assert len(labels(file)) == 3
