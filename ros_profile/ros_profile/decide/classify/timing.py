"""Sub-class, deadline and latency budget, by the period of the loop or stream (docs/evaluation/eo3-rules.md has the table)."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from ros_profile.decide.classify.features import Features, is_test
from ros_profile.model.conclusions import Estimate, QosClass, SubClass
from ros_profile.model.endpoints import Parameter, Timer
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Unit


@dataclass(frozen=True, slots=True)
class Row:
    """Seconds: the period when the source has none, and the bounds of deadline and budget. `share`: budget = share · period.
    None: no deadline, or no budget over a network.
    """

    period_s: float
    deadline_s: tuple[float, float] | None
    budget_s: tuple[float, float] | None
    share: float


ROWS = {
    SubClass.HARDWARE_LOOP: Row(0.002, (0.001, 0.005), None, 0.0),
    SubClass.CONTROL_LOOP: Row(0.01, (0.005, 0.02), (0.001, 0.005), 1 / 3),
    SubClass.MOTION: Row(0.05, (0.05, 0.1), (0.015, 0.03), 1 / 3),
    SubClass.SAFETY: Row(0.05, (0.01, 0.15), (0.001, 0.005), 1 / 3),
    SubClass.OPERATOR_INPUT: Row(0.05, (0.1, 0.2), (0.03, 0.05), 1.0),
    SubClass.INERTIAL: Row(0.01, (0.005, 0.01), (0.005, 0.01), 1.0),
    SubClass.CAMERA: Row(1 / 30, (1 / 30, 1 / 15), (1 / 30, 1 / 15), 1.0),
    SubClass.LIDAR: Row(0.1, (0.05, 0.2), (0.05, 0.1), 1.0),
    SubClass.DETECTOR: Row(0.1, (0.1, 0.1), (0.1, 0.15), 1.0),
    SubClass.PLANNER: Row(1.0, (1.0, 1.0), (0.25, 0.25), 0.25),
    SubClass.FLEET: Row(1.0, (1.0, 10.0), (0.5, 0.5), 0.5),
    SubClass.BEST_EFFORT: Row(1.0, None, None, 0.0),
}
WORDS = {
    SubClass.HARDWARE_LOOP: "hardware loop",
    SubClass.CONTROL_LOOP: "control loop or field bus",
    SubClass.MOTION: "motion: local planner, base driver or mux",
    SubClass.SAFETY: "safety gate",
    SubClass.OPERATOR_INPUT: "operator input",
    SubClass.INERTIAL: "inertial or joint states",
    SubClass.CAMERA: "camera or depth",
    SubClass.LIDAR: "lidar, SLAM or localisation",
    SubClass.DETECTOR: "detector",
    SubClass.PLANNER: "planner, behaviour tree or task server",
    SubClass.FLEET: "fleet or bridge",
    SubClass.BEST_EFFORT: "display, recording or tool",
}
"""What the rows are, for --explain; docs/evaluation/eo3-rules.md has the same table."""
_RATE = re.compile(r"(?:^|[._/])(?:\w*_)?(?:frequency|freq|rate|hz|fps|framerate|frame_rate)$", re.IGNORECASE)
_PERIOD = re.compile(r"(?:^|[._/])(?:\w*_)?(?:period|interval)(?:_s|_sec)?$", re.IGNORECASE)
_OTHER_RATE = re.compile(
    r"baud|bit|sample|transform|tf|diag|map_update|learning|retry|log|warn|expected|min_|max_|timeout|decay|reconnect|save|stat(?:us|istics)|heart_?beat|watchdog|check|monitor_|discover",
    re.IGNORECASE,
)
_HOUSEKEEPING: Final = re.compile(
    r"diag|watch_?dog|heart_?beat|reconnect|retry|(?:^|_)(?:log|print|save|init|start|connect|wait)|health|alive|time_?out|param|event|window|gui|stat(?:us|istics)|monitor|check|discover|clean",
    re.IGNORECASE,
)
"""Functions whose timers say nothing of how often the node works."""
_WORK: Final = re.compile(
    r"pub|send|read|write|update|control|loop|step|tick|capture|grab|cycle|cmd|run", re.IGNORECASE
)
_STALE = re.compile(r"(?:cmd|command|velocity|watchdog|heartbeat|source|stop_pub\w*)\w*_?timeout", re.IGNORECASE)
SHORTEST_S, LONGEST_S = 0.0005, 2.0
LONGEST_WITHOUT_A_NAME_S = 0.5
"""Slower loops and lambdas that publish nothing wait for something, or try again."""
_PARTS = {1.0: "", 1 / 3: "a third of ", 1 / 2: "half of ", 1 / 4: "a quarter of "}


def sub_class(found: Features, unit: Unit, value: QosClass, period: Estimate[float] | None) -> SubClass:
    """`period`: what `period_of` gives."""
    if value is QosClass.REALTIME:
        return _realtime(found, unit, period.value if period else None)
    if value is QosClass.SENSOR_DATA:
        return _sensor(found)
    if value is QosClass.SYSTEM_DEFAULT:
        fleet = found.any("word:network", "uses:network", "needs:network") or not found.any(
            "serve:action",
            "serve:planning",
            "call:planning",
            "plugin:planner",
            "word:planning",
            "hosts:planner",
            "word2:planning",
        )
        return SubClass.FLEET if fleet else SubClass.PLANNER
    return SubClass.BEST_EFFORT


def _realtime(found: Features, unit: Unit, fastest: float | None) -> SubClass:
    if found.any("shape:operator", "word:teleop") or ("pub:joy" in found):
        stops = re.search(r"(?:^|_)(?:e_?stop|emergency)(?:_|$)", unit.package.name)
        return SubClass.SAFETY if stops else SubClass.OPERATOR_INPUT
    if re.search(r"(?:^|_)(?:e_?stop|emergency|safety|failsafe|collision)(?:_|$)", f"{unit.package.name}_{unit.name}"):
        return SubClass.SAFETY
    loaded = found.any(
        "plugin:hardware",
        "plugin:controller",
        "hosts:controller",
        "hosts:hardware",
        "uses:realtime",
        "inherits:hardware",
    )
    if fastest is not None and fastest <= 0.005 and (loaded or "hardware:can" in found):
        return SubClass.HARDWARE_LOOP
    if loaded or found.any("hardware:can", "pub:fieldbus") or (fastest is not None and fastest <= 0.02):
        return SubClass.CONTROL_LOOP
    return SubClass.MOTION


def _sensor(found: Features) -> SubClass:
    if found.any("hardware:gpu", "word:perception"):
        return SubClass.DETECTOR
    carried = [fact.subject for name in ("pub:sensor", "sub:sensor") for fact in found.found.get(name, ())]
    if any("/PointCloud" in kind or "LaserScan" in kind for kind in carried) and "word:estimation" not in found:
        images = any(kind.endswith(("/Image", "/CompressedImage")) for kind in carried)
        return SubClass.CAMERA if images else SubClass.LIDAR
    if any(kind.endswith(("/Image", "/CompressedImage", "/CameraInfo", "/DisparityImage")) for kind in carried):
        return SubClass.CAMERA
    if not carried and "hardware:camera" in found:
        return SubClass.CAMERA
    if any(kind.endswith(("/Imu", "/MagneticField")) for kind in carried) or "pub:state" in found:
        return SubClass.INERTIAL
    return SubClass.LIDAR


def period_of(unit: Unit) -> Estimate[float] | None:
    """Seconds: the shortest literal period of a timer, else of a parameter that gives one, else of a rate parameter."""
    defaults = {p.name: p for p in reversed(unit.parameters) if not is_test(p.file)}
    timers = _working_timers([timer for timer in unit.timers if not is_test(timer.file)])
    literal = [(t.period_s, Fact(Kind.PERIOD, f"{t.period_s:g}", "timer", t.file, t.line)) for t in timers]
    by_timer = [
        found
        for timer in timers
        if timer.parameter in defaults and (found := _of(defaults[timer.parameter], is_rate=timer.parameter_is_rate))
    ]
    named = list(_named(unit))
    for candidates, confidence in ((literal, 0.8), (by_timer, 0.75), (named, 0.6)):
        usable = [(seconds, fact) for seconds, fact in candidates if SHORTEST_S <= seconds <= LONGEST_S]
        if usable:
            seconds, fact = min(usable, key=lambda pair: pair[0])
            return Estimate(seconds, confidence, (fact,), f"the period {_shown(seconds)} ({fact.value})")
    return None


def _working_timers(timers: list[Timer]) -> list[Timer]:
    """Returns the timers by which a node works: those that publish, read or control, else all but those that keep house."""
    related = [
        timer
        for timer in timers
        if (timer.runs or timer.period_s <= LONGEST_WITHOUT_A_NAME_S)
        and (not _HOUSEKEEPING.search(timer.runs) or re.match("_?(?:pub|send)", timer.runs))
    ]
    return [timer for timer in related if _WORK.search(timer.runs)] or related


def _of(parameter: Parameter, *, is_rate: bool) -> tuple[float, Fact] | None:
    try:
        number = float(parameter.default)
    except ValueError:
        return None
    if not 0 < number < 1e6:
        return None
    seconds = 1.0 / number if is_rate else number
    fact = Fact(Kind.PERIOD, f"{seconds:g}", f"parameter {parameter.name}", parameter.file, parameter.line)
    return seconds, fact


def _named(unit: Unit) -> Iterator[tuple[float, Fact]]:
    for parameter in unit.parameters:
        if is_test(parameter.file) or _OTHER_RATE.search(parameter.name):
            continue
        if (_RATE.search(parameter.name) and (found := _of(parameter, is_rate=True))) or (
            _PERIOD.search(parameter.name) and (found := _of(parameter, is_rate=False))
        ):
            yield found
        elif parameter.name.endswith("rpm") and (found := _of(parameter, is_rate=True)):
            yield found[0] * 60.0, found[1]


def deadline(unit: Unit, row: SubClass, period: Estimate[float] | None) -> Estimate[float] | None:
    """The period, and no less than the sub-class takes; the smallest stale-command timeout where there is no period.

    A deadline below the node's own period would be missed by every message, so a long period stands as it is.
    """
    bounds = ROWS[row].deadline_s
    if bounds is None:
        return None
    if period is not None:
        return _bounded(period.value, (bounds[0], LONGEST_S), period, row, period.reason)
    stale = _stale(unit)
    if stale is None:
        default = min(max(ROWS[row].period_s, bounds[0]), bounds[1])
        return Estimate(default, 0.4, (), f"usual for {row.value}, {WORDS[row]}")
    return _bounded(stale.value, bounds, stale, row, stale.reason)


def _stale(unit: Unit) -> Estimate[float] | None:
    found = [pair for p in unit.parameters if _STALE.search(p.name) and (pair := _of(p, is_rate=False))]
    usable = [(seconds, fact) for seconds, fact in found if 0.01 <= seconds <= LONGEST_S]
    if not usable:
        return None
    seconds, fact = min(usable, key=lambda pair: pair[0])
    return Estimate(seconds, 0.6, (fact,), f"commands are stale after {_shown(seconds)} ({fact.value})")


def budget(row: SubClass, period: Estimate[float] | None) -> Estimate[float] | None:
    """A third of the period of a loop, the period of a stream, half of what a client waits for an acknowledgement."""
    bounds = ROWS[row].budget_s
    if bounds is None:
        return None
    seconds = (period.value if period else ROWS[row].period_s) * ROWS[row].share
    if period is None:
        return Estimate(_within(seconds, bounds), 0.4, (), f"usual for {row.value}, {WORDS[row]}")
    share = ROWS[row].share
    part = _PARTS.get(share, f"{share:g} of ")
    return _bounded(seconds, bounds, period, row, f"{part}{period.reason}")


def _bounded(
    seconds: float, bounds: tuple[float, float], found: Estimate[float], row: SubClass, reason: str
) -> Estimate[float]:
    """A value within the bounds of its row; the reason tells when these moved it."""
    value = _within(seconds, bounds)
    if value > round(seconds, 6):
        reason = f"{reason}; {row.value} takes no less than {_shown(value)}"
    elif value < round(seconds, 6):
        reason = f"{reason}; {row.value} takes no more than {_shown(value)}"
    return Estimate(value, found.confidence, found.evidence, reason)


def _within(value: float, bounds: tuple[float, float]) -> float:
    return round(min(max(value, bounds[0]), bounds[1]), 6)


def _shown(seconds: float) -> str:
    return f"{seconds:g} s" if seconds >= 1 else f"{seconds * 1000:.3g} ms"
