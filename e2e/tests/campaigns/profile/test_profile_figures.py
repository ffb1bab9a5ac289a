"""Figures of the profile bench: accuracy, calibration and the targets."""

from dataclasses import replace

from campaigns.profile.profile import Case, calibration_error, figures, folds, reliability

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
