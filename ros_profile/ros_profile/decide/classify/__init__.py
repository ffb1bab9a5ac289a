"""Classification: `classify` judges a unit, `aggregate` joins the judgements of what runs together. Pure."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from ros_profile.decide.classify import curation, timing
from ros_profile.decide.classify.features import Features, features, is_test, name_roles
from ros_profile.decide.classify.hardware import Devices, certainty, devices, doubted, linked_devices, needed
from ros_profile.decide.classify.judge import judged
from ros_profile.decide.classify.placing import bandwidth, placement
from ros_profile.model.conclusions import Assessment, Estimate, Hardware, Placement, SubClass
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Unit

_SAMPLE = re.compile(r"(?:^|/)(?:examples?|samples?)/")
_BRINGUP = re.compile(r"(?:^|_)(?:bringup|bring_up|launch|launcher|startup)(?:_|$)")
_CODE = (".cpp", ".cc", ".cxx", ".c", ".cu", ".hpp", ".h", ".py")
CERTAIN_ENOUGH = 0.49
"""What a launch file starts counts for its class from this confidence on."""


def classify(unit: Unit, *, curated: bool, libraries: Mapping[str, Devices] | None = None) -> Assessment:
    """`libraries`: devices that packages of the same workspace open, by package, for nodes that link these as libraries."""
    unit = _without_samples(unit)
    found = features(unit)
    opened = {} if only_assets(unit) else linked_devices(devices(unit), unit, libraries or {})
    if curated:
        curation.apply(unit, found, opened)
    wanted = needed(opened)
    for estimate in wanted:
        found.add(f"hardware:{estimate.value.type}", estimate.evidence[0])
        if estimate.value.model == "joystick" and not estimate.reason.startswith("links "):
            found.add("shape:operator_device", estimate.evidence[0])
    _after_hardware(found, unit)
    only_hardware = Assessment(
        None,
        hardware=wanted,
        hardware_confidence=round(certainty(opened), 3),
        doubted=doubted(opened),
        lifecycle=_has_lifecycle(unit),
    )
    qos = judged(found)
    if qos is None:
        return only_hardware
    period = timing.period_of(unit)
    row = timing.sub_class(found, unit, qos.value, period)
    return replace(
        only_hardware,
        qos_class=qos,
        sub_class=Estimate(row, round(qos.confidence * 0.9, 3), qos.evidence[:3], timing.WORDS[row]),
        deadline_s=timing.deadline(unit, row, period),
        latency_budget_s=timing.budget(row, period),
        placement=placement(found, unit, qos.value, row),
        bandwidth_bps=bandwidth(found),
        hints=_hints(found, row),
    )


def _without_samples(unit: Unit) -> Unit:
    """Returns a package without its samples of how a library is used, where it has other code."""
    code = [file for file in unit.files if file.endswith(_CODE) and not _SAMPLE.search(file)]
    if unit.kind != "package" or not code:
        return unit
    return replace(
        unit,
        facts=tuple(fact for fact in unit.facts if not _SAMPLE.search(fact.file)),
        endpoints=tuple(endpoint for endpoint in unit.endpoints if not _SAMPLE.search(endpoint.file)),
        timers=tuple(timer for timer in unit.timers if not _SAMPLE.search(timer.file)),
        parameters=tuple(parameter for parameter in unit.parameters if not _SAMPLE.search(parameter.file)),
        files=tuple(file for file in unit.files if not _SAMPLE.search(file)),
    )


def only_assets(unit: Unit) -> bool:
    """Models, views and worlds by the package's name, and no code: a device that a model names is opened by a driver."""
    named = name_roles(unit.package.name)[:1]
    assets = bool(named) and named[0] in {"display", "tool", "simulation"} and not is_bringup(unit.package.name)
    return assets and unit.kind == "package" and not unit.languages & {"cpp", "python"}


def is_bringup(name: str) -> bool:
    """Returns whether a package starts a robot, by its name: a helper among its programs does not say what it is."""
    return _BRINGUP.search(name) is not None


def runs_code(unit: Unit) -> bool:
    """Something of the package's code becomes a node or a plug-in; helpers for launch files do not."""
    return bool(unit.languages & {"cpp", "python"}) and not features(unit).any("shape:launch_and_code")


def _after_hardware(found: Features, unit: Unit) -> None:
    """Shapes that need to know of a device: what only reports it, and what switches pins on request. A node of which
    only the name is known may read its serial line or drive something by it.
    """
    owned = [name for name in found.found if name.startswith("hardware:") and name != "hardware:gpu"]
    if not owned:
        return
    first = found.found[owned[0]][0]
    if "sub:command" in found:
        found.add("shape:base_driver", first)
    publishes = found.any("pub:other", "pub:state", "pub:sensor", "pub:measured")
    if publishes and not any(name.startswith("sub:") for name in found.found):
        found.add("shape:device_source", first)
    _after_line(found, first)
    told = ("shape:device_report", "shape:signal_output", "shape:discrete_io")
    line = found.any("hardware:serial", "hardware:can") and not found.any(*told)
    senses = ("pub:sensor", "sub:sensor", "pub:interpreted", "word:sensing", "word:estimation", "word:perception")
    if line and unit.files and not found.any(*senses, "uses:display", "word:display", "call:planning"):
        found.add("shape:device_link", first)
    if (
        "hardware:gpio" in found
        and found.any("sub:other", "sub:command_text", "serve:service")
        and not found.any("pub:sensor", "sub:command")
    ):
        found.add("shape:discrete_io", first)


def _after_line(features: Features, first: Fact) -> None:
    """A serial line that only reports what hangs on it, and one that only shows something to people, control nothing."""
    if "hardware:serial" not in features or features.any("sub:command", "pub:command", "sub:joy", "pub:joy", *_LOOPS):
        return
    streams = any(name.startswith(("sub:", "pub:")) and name not in _REPORTS for name in features.found)
    if not streams and features.any("serve:action", "serve:service"):
        features.add("shape:discrete_io", first)
    elif features.any("word:io", "word2:io", "word:display") and not features.any("pub:sensor", "pub:state"):
        features.add("shape:signal_output", first)
    elif features.any("pub:state", "pub:pose", "pub:other", "pub:measured") and not any(
        name.startswith("sub:") for name in features.found
    ):
        features.add("shape:device_report", first)


_REPORTS = frozenset({"pub:state", "pub:other", "pub:measured", "pub:diagnostics"})
"""What a device that works on request tells of itself."""
_LOOPS = ("plugin:hardware", "plugin:controller", "hosts:hardware", "hosts:controller", "inherits:hardware")


def _has_lifecycle(unit: Unit) -> bool:
    return any(
        fact.kind in {Kind.INHERITS, Kind.NODE} and "Lifecycle" in fact.subject and not is_test(fact.file)
        for fact in unit.facts
    )


def _hints(found: Features, row: SubClass) -> tuple[str, ...]:
    if row is SubClass.HARDWARE_LOOP:
        return ("its loop bears no network: it belongs into the pod, or at least on the node, of its device",)
    if row is SubClass.PLANNER and found.any("serve:planning", "plugin:planner", "hosts:planner"):
        return (
            "the Nav2 behaviour tree waits 20 ms for an acknowledgement: raise default_server_timeout off the robot",
        )
    return ()


def aggregate(assessments: Sequence[Assessment]) -> Assessment:
    """The most demanding class with the tightest times, and the union of the hardware."""
    judgements = [a for a in assessments if a.qos_class is not None]
    sure = [a for a in judgements if a.qos_class and a.qos_class.confidence >= CERTAIN_ENOUGH] or judgements
    hardware = _most_certain(estimate for a in assessments for estimate in a.hardware)
    required = {estimate.value.type for estimate in hardware}
    doubts = _most_certain(e for a in assessments for e in a.doubted if e.value.type not in required)
    certain = min((a.hardware_confidence for a in assessments), default=1.0)
    if not sure:
        return Assessment(None, hardware=hardware, hardware_confidence=certain, doubted=doubts)
    lead = min(sure, key=_demand)
    same = [a for a in sure if a.qos_class and lead.qos_class and a.qos_class.value is lead.qos_class.value]
    return Assessment(
        qos_class=lead.qos_class,
        sub_class=lead.sub_class,
        deadline_s=_tightest([a.deadline_s for a in same]),
        latency_budget_s=_tightest([a.latency_budget_s for a in same]),
        hardware=hardware,
        hardware_confidence=certain,
        doubted=doubts,
        placement=_joined_placement(assessments, lead),
        bandwidth_bps=_summed([a.bandwidth_bps for a in assessments]),
        lifecycle=any(a.lifecycle for a in assessments),
        hints=tuple(dict.fromkeys(hint for a in assessments for hint in a.hints)),
    )


def _demand(assessment: Assessment) -> tuple[float, float]:
    """Sorts by class, the most demanding first, then by confidence."""
    qos = assessment.qos_class
    return (qos.value.rank, -qos.confidence) if qos else (math.inf, 0.0)


def _most_certain(estimates: Iterable[Estimate[Hardware]]) -> tuple[Estimate[Hardware], ...]:
    """The most certain one of each type, by type."""
    best: dict[str, Estimate[Hardware]] = {}
    for estimate in estimates:
        known = best.get(estimate.value.type)
        if known is None or estimate.confidence > known.confidence:
            best[estimate.value.type] = estimate
    return tuple(best[kind] for kind in sorted(best))


def _tightest(estimates: Sequence[Estimate[float] | None]) -> Estimate[float] | None:
    return min((e for e in estimates if e is not None), key=lambda e: e.value, default=None)


def _summed(estimates: Sequence[Estimate[float] | None]) -> Estimate[float] | None:
    known = [e for e in estimates if e is not None]
    if not known:
        return None
    evidence: tuple[Fact, ...] = tuple(fact for e in known for fact in e.evidence)[:5]
    return Estimate(sum(e.value for e in known), min(e.confidence for e in known), evidence, known[0].reason)


def _joined_placement(assessments: Sequence[Assessment], lead: Assessment) -> Estimate[Placement] | None:
    """On the robot as soon as one part has to be there."""
    bound = [a.placement for a in assessments if a.placement and a.placement.value is Placement.ROBOT]
    return max(bound, key=lambda e: e.confidence) if bound else lead.placement
