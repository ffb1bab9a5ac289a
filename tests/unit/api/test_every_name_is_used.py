"""Every label, annotation, condition, reason and event that docs/names.md lists is written or read by code of ours."""

import re
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Final

import pytest

from robotapp_api.model import names

ROOT: Final = Path(__file__).resolve().parents[3]
PACKAGES: Final = (
    "crds/robotapp_api",
    "client/robotapp_client",
    "claims/robotapp_claims",
    "operator/robotapp_operator",
    "scheduler/robotapp_scheduler",
    "agent/robotapp_agent",
    "cli/robotapp_cli",
    "rigel_bridge/rigel_bridge",
    "e2e/robotapp_testbed",
)
UNTIL_LATER: Final[frozenset[str]] = frozenset()
"""Names of things that a later issue builds."""


def enums() -> Iterator[type[StrEnum]]:
    for value in vars(names).values():
        if isinstance(value, type) and issubclass(value, StrEnum) and value is not StrEnum:
            yield value


def sources() -> str:
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py") if path.name != "names.py")
    return "\n".join(path.read_text() for path in files)


@pytest.fixture(scope="module")
def used() -> frozenset[str]:
    """As `Enum.MEMBER`. The event of a condition that has turned bears the condition's reason."""
    found = set(re.findall(r"\b(?:names\.)?([A-Z]\w+\.[A-Z][A-Z0-9_]+)\b", sources()))
    events = {f"Event{name}" for name in found if name.startswith("Reason.")}
    return frozenset(found | events)


@pytest.mark.parametrize("enum", list(enums()), ids=lambda enum: str(enum.__name__))
def test_every_member_is_used_or_waits_for_a_later_issue(enum: type[StrEnum], used: frozenset[str]) -> None:
    members = {f"{enum.__name__}.{member.name}" for member in enum}
    assert members - used - UNTIL_LATER == set(), "remove the name, or build what it stands for"
    assert members & used & UNTIL_LATER == set(), "it is built: take it off the list"
