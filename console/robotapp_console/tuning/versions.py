"""The history of a configuration: who applied which text when. It is kept in a ConfigMap, one key per version."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

KEPT: Final = 20
KEPT_BYTES: Final = 900_000
"""A ConfigMap takes a mebibyte."""
UNKNOWN_AUTHOR: Final = "unknown (not by the console)"
NAMELESS_AUTHOR: Final = "a user whose name the API server does not give"
MOST_NUMBER: Final = 99_999_999_999
_KEY: Final = re.compile(r"version-([0-9]{6,11})")


@dataclass(frozen=True, slots=True)
class Version:
    """One version. `at` is a time of the API server's form; `by` is the name that the API server gives the user."""

    number: int
    at: str
    by: str
    text: str

    @property
    def key(self) -> str:
        return f"version-{self.number:06}"

    def encode(self) -> str:
        return json.dumps({"at": self.at, "by": self.by, "text": self.text}, ensure_ascii=False)


def read_versions(data: Mapping[str, str]) -> tuple[Version, ...]:
    """Returns the versions, the oldest first. Keys and values that are none are left out."""
    versions = (_read_version(key, value) for key, value in data.items())
    return tuple(sorted((version for version in versions if version is not None), key=lambda version: version.number))


def plan_addition(versions: Sequence[Version], text: str, *, at: str, by: str) -> dict[str, str | None]:
    """Returns the change of the ConfigMap's data: the new version, and None for those that are kept no longer.

    Somebody else may have written the greatest number, which has no next one; then all are numbered anew.
    """
    changes: dict[str, str | None] = {}
    if versions and versions[-1].number >= MOST_NUMBER:
        changes |= dict.fromkeys(version.key for version in versions)
        versions = [replace(version, number=number) for number, version in enumerate(versions, start=1)]
        changes |= {version.key: version.encode() for version in versions}
    number = versions[-1].number + 1 if versions else 1
    new_version = Version(number, at, by, text)
    changes[new_version.key] = new_version.encode()
    free_bytes, free_count = KEPT_BYTES - _measure(new_version), KEPT - 1
    for version in reversed(versions):
        free_bytes, free_count = free_bytes - _measure(version), free_count - 1
        if free_bytes < 0 or free_count < 0:
            changes[version.key] = None
    return changes


def is_recorded(versions: Sequence[Version], text: str) -> bool:
    """Returns whether the newest version has this text."""
    return bool(versions) and versions[-1].text == text


def find_previous(versions: Sequence[Version], text: str) -> Version | None:
    """Returns what undo brings back: the version before the one in the ConfigMap, or the newest where that one is not recorded."""
    for index in range(len(versions) - 1, -1, -1):
        if versions[index].text == text:
            earlier = [version for version in versions[:index] if version.text != text]
            return earlier[-1] if earlier else None
    return versions[-1] if versions else None


def _measure(version: Version) -> int:
    return len(version.encode().encode("utf-8", "replace")) + len(version.key)


def _read_version(key: str, value: str) -> Version | None:
    match = _KEY.fullmatch(key)
    if match is None:
        return None
    try:
        content: Any = json.loads(value)
        at, by, text = (str(content[name]) for name in ("at", "by", "text"))
        f"{at}{by}{text}".encode()  # half a character could be neither shown nor written again
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    version = Version(int(match[1]), at, by, text)
    return version if version.key == key else None
