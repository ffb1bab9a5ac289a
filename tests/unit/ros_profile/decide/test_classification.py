"""Classes with probabilities, times within their bounds, what runs together, the table and the thesis' heuristic."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_profile.decide import thesis
from ros_profile.decide.classify import aggregate, classify
from ros_profile.decide.classify.judge import probabilities, scores
from ros_profile.decide.classify.phrases import phrase
from ros_profile.decide.classify.timing import ROWS, budget, deadline, period_of
from ros_profile.decide.classify.weights import WEIGHTS
from ros_profile.knowledge.curated import PACKAGES
from ros_profile.knowledge.hardware import TYPES
from ros_profile.model.conclusions import Assessment, Estimate, Hardware, QosClass, SubClass
from ros_profile.model.endpoints import Timer
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Manifest, Unit


def unit(*facts: Fact, name: str = "thing", timers: tuple[Timer, ...] = ()) -> Unit:
    return Unit(Manifest(name), name, "package", facts, timers=timers, files=("src/a.cpp",))


def depends(*names: str) -> tuple[Fact, ...]:
    return tuple(Fact(Kind.DEPENDENCY, name, "both", "package.xml") for name in names)


def given_class(value: QosClass, confidence: float, *hardware: str, deadline_s: float = 1.0) -> Assessment:
    devices = tuple(Estimate(Hardware(kind), confidence) for kind in hardware)
    return Assessment(Estimate(value, confidence), deadline_s=Estimate(deadline_s, 0.5), hardware=devices)


@given(st.lists(st.sampled_from(sorted(WEIGHTS)), max_size=30))
def test_probabilities_of_any_features_sum_to_one(names: list[str]) -> None:
    likely = probabilities(scores(names))
    assert sum(likely) == pytest.approx(1.0)
    assert all(0.0 <= one <= 1.0 for one in likely)


@given(st.sampled_from(sorted(ROWS)), st.floats(min_value=0.0005, max_value=2.0))
def test_a_deadline_is_never_below_the_period_and_a_budget_keeps_to_its_row(row: SubClass, period_s: float) -> None:
    timed = unit(timers=(Timer("src/a.cpp", 1, period_s, runs="publish"),))
    period = period_of(timed)
    limits = ROWS[row]
    longest, allowed = deadline(timed, row, period), budget(row, period)
    assert (longest is None, allowed is None) == (limits.deadline_s is None, limits.budget_s is None)
    if longest is not None and limits.deadline_s is not None:
        assert longest.value == pytest.approx(max(period_s, limits.deadline_s[0]), abs=1e-6)
    if allowed is not None and limits.budget_s is not None:
        assert limits.budget_s[0] - 1e-6 <= allowed.value <= limits.budget_s[1] + 1e-6


@pytest.mark.parametrize(
    ("timers", "wanted"),
    [
        ((("publish_scan", 0.1), ("check_connection", 0.01)), 0.1),
        ((("reconnect", 1.0),), None),
        ((("on_timer", 0.1), ("diagnostics_update", 0.02)), 0.1),
        ((("publish_status", 0.5),), 0.5),
        ((("", 0.2),), 0.2),
        ((("", 1.0),), None),
        ((("publish", 1.0),), 1.0),
        ((("read_frame", 0.05), ("", 0.001)), 0.05),
    ],
)
def test_a_period_is_that_of_the_timer_by_which_a_node_works(
    timers: tuple[tuple[str, float], ...], wanted: float | None
) -> None:
    listed = tuple(Timer("src/a.cpp", 1, period_s, runs=name) for name, period_s in timers)
    found = period_of(unit(timers=listed))
    assert (found.value if found else None) == wanted


def test_a_reason_tells_the_period_and_the_bound_that_moved_the_value() -> None:
    period = period_of(unit(timers=(Timer("src/a.cpp", 1, 0.01),)))
    found = deadline(unit(), SubClass.LIDAR, period)
    assert found
    assert (found.value, found.reason) == (0.05, "the period 10 ms (timer); SD-C takes no less than 50 ms")
    slow = period_of(unit(timers=(Timer("src/a.cpp", 1, 0.5),)))
    reasons = [one.reason for one in (budget(SubClass.MOTION, slow), deadline(unit(), SubClass.MOTION, None)) if one]
    assert reasons == [
        "a third of the period 500 ms (timer); RT-C takes no more than 30 ms",
        "usual for RT-C, motion: local planner, base driver or mux",
    ]
    exact = deadline(unit(), SubClass.MOTION, period_of(unit(timers=(Timer("src/a.cpp", 1, 0.08),))))
    assert exact
    assert exact.reason == "the period 80 ms (timer)"


def test_the_most_demanding_of_what_runs_together_counts() -> None:
    joined = aggregate(
        [
            given_class(QosClass.SENSOR_DATA, 0.9, "camera", deadline_s=0.03),
            given_class(QosClass.REALTIME, 0.6, "serial", deadline_s=0.05),
            given_class(QosClass.BEST_EFFORT, 0.9),
        ]
    )
    assert joined.qos_class is not None
    assert joined.qos_class.value is QosClass.REALTIME
    assert joined.deadline_s == Estimate(0.05, 0.5)
    assert [device.value.type for device in joined.hardware] == ["camera", "serial"]


def test_a_guess_does_not_outrank_what_is_sure() -> None:
    joined = aggregate([given_class(QosClass.REALTIME, 0.3), given_class(QosClass.SYSTEM_DEFAULT, 0.8)])
    assert joined.qos_class == Estimate(QosClass.SYSTEM_DEFAULT, 0.8)
    assert aggregate([]) == Assessment(None)


def test_the_table_is_a_layer_that_can_be_left_out() -> None:
    known = Unit(Manifest("realsense2_camera"), "realsense2_camera_node", "program")
    with_table, without = classify(known, curated=True), classify(known, curated=False)
    assert {device.value.type for device in with_table.hardware} == {"usb", "camera"}
    assert without.hardware == ()
    assert with_table.qos_class is not None
    assert with_table.qos_class.evidence[0].kind is Kind.CURATED


def test_every_entry_of_the_table_is_of_our_vocabulary() -> None:
    for name, entry in PACKAGES.items():
        assert QosClass(entry.qos_class), name
        assert set(entry.hardware) <= set(TYPES), name


def test_evidence_and_a_reason_come_with_every_conclusion() -> None:
    found = classify(unit(Fact(Kind.SYMBOL, "serial::Serial", "", "src/a.cpp", 7)), curated=False)
    (device,) = found.hardware
    assert (device.value.type, device.evidence[0].place, device.reason) == (
        "serial",
        "src/a.cpp:7",
        "symbol serial::Serial",
    )


def test_every_feature_with_a_weight_has_words_of_its_own() -> None:
    features = sorted(name for name in WEIGHTS if name != "bias")
    assert not [name for name in features if ":" in phrase(name) or "{" in phrase(name)]
    assert phrase("pub:command") == "publishes commands"


def test_weak_evidence_is_no_device() -> None:
    found = classify(unit(Fact(Kind.BUILD, "find_package", "serial", "CMakeLists.txt", 1, 0.5)), curated=False)
    assert found.hardware == ()
    assert found.hardware_confidence < 0.8
    (doubt,) = found.doubted
    assert doubt.value.type == "serial", "the user decides"


def test_what_one_part_needs_for_sure_is_not_doubted_for_the_whole() -> None:
    serial, can = Estimate(Hardware("serial"), 0.3), Estimate(Hardware("can"), 0.4)
    joined = aggregate(
        [
            Assessment(None, doubted=(serial, can)),
            Assessment(None, hardware=(replace(serial, confidence=0.9),)),
            Assessment(None, doubted=(replace(can, confidence=0.3),)),
        ]
    )
    assert [one.value.type for one in joined.hardware] == ["serial"]
    assert joined.doubted == (can,)


@pytest.mark.parametrize(
    ("facts", "wanted", "hardware"),
    [
        (depends("geometry_msgs"), "best_effort", []),
        ((*depends("geometry_msgs"), Fact(Kind.INCLUDE, "geometry_msgs.msg.Twist", "", "a.py", 1)), "realtime", []),
        (depends("sensor_msgs", "usb_cam"), "sensor_data", ["usb"]),
        (depends("cv_bridge", "depth_image_proc"), "sensor_data", ["gpu"]),
        (depends("std_msgs"), "best_effort", []),
    ],
)
def test_the_heuristic_of_the_thesis_gives_its_published_answers(
    facts: tuple[Fact, ...], wanted: str, hardware: list[str]
) -> None:
    found = thesis.classify(unit(*facts))
    assert found.qos_class is not None
    assert (found.qos_class.value.value, [device.value.type for device in found.hardware]) == (wanted, hardware)
