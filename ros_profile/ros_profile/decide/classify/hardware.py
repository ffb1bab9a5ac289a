"""Which devices a unit opens itself, by type, each with a probability and the facts behind it."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

from ros_profile.decide.classify.features import MEMORY, is_test
from ros_profile.decide.places import abroad
from ros_profile.knowledge import hardware as signs
from ros_profile.model.conclusions import Estimate, Hardware
from ros_profile.model.endpoints import Role
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Unit

Devices = dict[str, Estimate[Hardware]]
"""By type, with every probability above 0, also those below the threshold."""
THRESHOLD = 0.5
"""Hardware of this probability is required of a node; what is less probable is doubted."""
SHOWN = 0.25
"""Hardware that is less probable is not even doubted."""
UNUSED = 0.6
"""How much a dependency counts that nothing in the code shows."""
MODULE = "module "
"""Before the dotted name of a module of Python, among the names of libraries."""
LINKED = 0.85
"""How much of a library's own certainty passes to what includes its headers."""
_TABLES = {
    Kind.SYMBOL: signs.SYMBOLS,
    Kind.INCLUDE: signs.INCLUDES,
    Kind.DEPENDENCY: signs.DEPENDENCIES,
    Kind.DEVICE_PATH: signs.DEVICES,
    Kind.TEXT: signs.DEVICES,
    Kind.UDEV: signs.UDEV,
    Kind.BUILD: signs.BUILD,
    Kind.NAME: signs.NAMES,
}
VIDEO_SOURCE = 0.6
"""How often OpenCV's video source of a node that publishes pictures is a webcam, and no file."""
_VIDEO = re.compile(r"^cv2?(?:\.|::)VideoCapture$")
_FILE_PARAMETER = re.compile(r"(?:^|[_.])(?:file\w*|(?<!info_)(?:url|uri))(?:$|[_.])")
_PICTURES = frozenset({"sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"})
_CONTROLLER = re.compile(r"^controller_interface::")
_ID = re.compile(r"^[0-9a-f]{4}:[0-9a-f]{4}$")


@dataclass(slots=True)
class _Case:
    """What speaks for one type: the strongest weight of each kind of evidence, so that ten equal lines count once."""

    weights: dict[Kind, float] = field(default_factory=dict)
    facts: list[Fact] = field(default_factory=list)
    model: str = ""
    interface: str = ""

    @property
    def probability(self) -> float:
        wrong = 1.0
        for weight in self.weights.values():
            wrong *= 1.0 - min(weight, 0.97)
        return 1.0 - wrong


def devices(unit: Unit) -> Devices:
    cases: dict[str, _Case] = {}
    name = () if _is_controller(unit) else (Fact(Kind.NAME, unit.package.name, "", unit.package.file),)
    own = {file.rpartition("/")[2] for file in unit.files}
    for fact in (*name, *unit.facts):
        if is_test(fact.file) or (fact.kind is Kind.INCLUDE and fact.value and fact.subject.rpartition("/")[2] in own):
            continue
        for sign, weight in _matches(fact):
            for gives in sign.gives:
                case = cases.setdefault(gives, _Case())
                case.weights[fact.kind] = max(case.weights.get(fact.kind, 0.0), weight)
                case.facts.append(fact)
                case.model = case.model or sign.model
                case.interface = case.interface or sign.interface
    if _is_video_source(unit, cases):
        cases["camera"].weights[Kind.SYMBOL] = max(cases["camera"].weights.get(Kind.SYMBOL, 0.0), VIDEO_SOURCE)
        cases.setdefault("usb", _Case(facts=cases["camera"].facts)).weights.setdefault(Kind.SYMBOL, VIDEO_SOURCE)
    if unit.languages & {"cpp", "python"}:
        for case in cases.values():
            if case.weights.keys() == {Kind.DEPENDENCY}:  # the code is here and uses nothing of it
                case.weights[Kind.DEPENDENCY] *= UNUSED
    identity = _usb_id(unit.facts)
    return {kind: _estimate(kind, case, identity) for kind, case in sorted(cases.items())}


def _is_video_source(unit: Unit, cases: Mapping[str, _Case]) -> bool:
    """Returns whether OpenCV reads pictures that the unit publishes and does not get by a topic: a webcam's."""
    opening = (
        {fact.file for fact in cases["camera"].facts if _VIDEO.search(fact.subject)} if "camera" in cases else set()
    )
    pictures = {e.role for e in unit.endpoints if e.type in _PICTURES and e.file in opening}
    elsewhere = any(fact.kind is Kind.TEXT and "://" in fact.subject for fact in unit.facts)
    elsewhere = elsewhere or any(_FILE_PARAMETER.search(parameter.name) for parameter in unit.parameters)
    return pictures == {Role.PUBLISHER} and not elsewhere


def _is_controller(unit: Unit) -> bool:
    """Controllers reach hardware through interfaces only (ros2_control): no library and no name makes them open any."""
    return any(fact.kind is Kind.PLUGIN_BASE and _CONTROLLER.search(fact.subject) for fact in unit.facts)


def _matches(fact: Fact) -> Iterator[tuple[signs.Sign, float]]:
    text = f"{fact.subject} {fact.value}" if fact.kind is Kind.BUILD else fact.subject
    if fact.kind in _TABLES and (sign := _sign(fact.kind, text)) is not None:
        yield sign, sign.weight * fact.weight


@lru_cache(maxsize=MEMORY)
def _sign(kind: Kind, text: str) -> signs.Sign | None:
    return next((sign for sign in _TABLES[kind] if sign.pattern.search(text)), None)


def _estimate(kind: str, case: _Case, identity: str) -> Estimate[Hardware]:
    best = sorted(case.facts, key=lambda fact: (fact.kind is not Kind.SYMBOL, fact.kind is not Kind.DEVICE_PATH))
    usb_id = identity if kind in {"usb", "camera", "serial"} else ""
    first = best[0]
    hardware = Hardware(kind, case.model, case.interface, usb_id)
    return Estimate(hardware, round(case.probability, 3), tuple(best[:5]), f"{first.kind.value} {first.subject}")


def _usb_id(facts: Iterable[Fact]) -> str:
    """The one vendor and product that udev rules name; empty when there are several: a choice would be a guess."""
    found = {fact.subject for fact in facts if fact.kind is Kind.UDEV and _ID.match(fact.subject)}
    return next(iter(found)) if len(found) == 1 else ""


def linked_devices(own: Devices, unit: Unit, libraries: Mapping[str, Devices]) -> Devices:
    """With what libraries of the same workspace open: a header of theirs is included, so their code runs in this process."""
    found = dict(own)
    if _is_controller(unit):
        return found
    for fact in unit.facts:
        package = fact.subject.partition("/")[0].partition(".")[0]
        if fact.kind is not Kind.INCLUDE or package == unit.package.name or is_test(fact.file):
            continue
        for kind, estimate in _of_library(fact, package, libraries).items():
            probability = round(estimate.confidence * LINKED, 3)
            if kind not in found or found[kind].confidence < probability:
                theirs = (replace(one, file=abroad(package, one.file)) for one in estimate.evidence[:2])
                found[kind] = Estimate(estimate.value, probability, (fact, *theirs), f"links {package}")
    return found


def _of_library(fact: Fact, package: str, libraries: Mapping[str, Devices]) -> Devices:
    """Returns what a header's library opens, or a module of Python with what it imports: of that nothing else runs."""
    if not fact.file.endswith(".py"):
        return libraries.get(package, {})
    parts = fact.subject.split(".")
    modules = (MODULE + ".".join(parts[:length]) for length in range(len(parts), 0, -1))
    return next((libraries[module] for module in modules if module in libraries), {})


def needed(found: Devices) -> tuple[Estimate[Hardware], ...]:
    """What a node must have."""
    return tuple(estimate for estimate in found.values() if estimate.confidence >= THRESHOLD)


def doubted(found: Devices) -> tuple[Estimate[Hardware], ...]:
    """What the user should decide about."""
    return tuple(estimate for estimate in found.values() if SHOWN <= estimate.confidence < THRESHOLD)


def certainty(found: Devices) -> float:
    """Probability that the list is exactly right."""
    product = 1.0
    for estimate in found.values():
        product *= max(estimate.confidence, 1.0 - estimate.confidence)
    return product
