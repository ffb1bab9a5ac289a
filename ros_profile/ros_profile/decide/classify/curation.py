"""The table of well-known packages as a layer of its own: one more feature and one more sign of a device."""

import re

from ros_profile.decide.classify.features import Features
from ros_profile.decide.classify.hardware import Devices
from ros_profile.knowledge.curated import PACKAGES, Entry
from ros_profile.model.conclusions import Estimate, Hardware
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Unit

CERTAINTY = 0.9
_NETWORKED = re.compile(r"(?:^|_)(?:socket|tcp|udp|ip|ethernet|net)(?:_|$)")
"""A program of a driver that reaches its device over the network."""


def apply(unit: Unit, found: Features, opened: Devices) -> None:
    """Adds what the table has of the unit's package, for the package as a whole and for a launched node of which only
    the name is known: of a program whose source is there, the source tells more.
    """
    entry = PACKAGES.get(unit.package.name)
    if entry is None or (unit.kind != "package" and unit.files):
        return
    fact = Fact(Kind.CURATED, unit.package.name, entry.text(), unit.package.file)
    found.add(f"curated:{entry.qos_class}", fact)
    networked = unit.kind != "package" and _NETWORKED.search(unit.name)
    for kind in entry.hardware:
        if networked and kind == "serial":
            continue
        _add(kind, entry, fact, opened)


def _add(kind: str, entry: Entry, fact: Fact, opened: Devices) -> None:
    known = opened.get(kind)
    if known is None or known.confidence < CERTAINTY:
        evidence = (fact, *(known.evidence if known else ()))
        hardware = known.value if known else Hardware(kind, entry.model)
        opened[kind] = Estimate(hardware, CERTAINTY, evidence[:5], "table of well-known packages")
