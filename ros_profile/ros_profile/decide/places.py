"""Evidence of one package where the assessment of another one stands on it: each place names the file that is meant.

Readers give files relative to their package. A launch file starts nodes of other packages, and a program links libraries
of other packages: there `src/driver.cpp` would be looked for in the wrong folder. Such a file is `package/src/driver.cpp`.
"""

from dataclasses import fields, replace
from typing import Any, Final

from ros_profile.model.conclusions import Assessment, Estimate
from ros_profile.model.facts import Fact

_ABROAD: Final = "//"
"""Before `package/file`, until the assessment is placed. No file of a package begins with a slash."""
TABLE: Final = "curated"
"""Stands for a file where the table of well-known nodes is the source."""


def abroad(package: str, file: str) -> str:
    """A file of a package that need not be the one judged."""
    if not file or file == TABLE or file.startswith(_ABROAD):
        return file
    return f"{_ABROAD}{package}/{file}"


def placed(assessment: Assessment, *, of: str, within: str) -> Assessment:
    """The assessment of a unit of package `of`, with its evidence as seen from package `within`."""
    changed: dict[str, Any] = {}
    for one in fields(assessment):
        value = getattr(assessment, one.name)
        if isinstance(value, Estimate):
            changed[one.name] = _estimate(value, of, within)
        elif one.name in ("hardware", "doubted"):
            changed[one.name] = tuple(_estimate(device, of, within) for device in value)
    return replace(assessment, **changed)


def _estimate(estimate: Estimate[Any], of: str, within: str) -> Estimate[Any]:
    if of == within and not any(fact.file.startswith(_ABROAD) for fact in estimate.evidence):
        return estimate
    return replace(estimate, evidence=tuple(_fact(fact, of, within) for fact in estimate.evidence))


def _fact(fact: Fact, of: str, within: str) -> Fact:
    if of == within and not fact.file.startswith(_ABROAD):
        return fact
    return replace(fact, file=abroad(of, fact.file).removeprefix(_ABROAD).removeprefix(f"{within}/"))
