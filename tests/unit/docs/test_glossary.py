"""docs/glossary.md names what is in the code, and explains every old word that is still the name of a module or class."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from robotapp_scheduler.core.framework.validation import HOOKS
from robotapp_scheduler.core.pods.pod_info import FEATURES

ROOT: Final = Path(__file__).resolve().parents[3]
GLOSSARY: Final = ROOT / "docs" / "glossary.md"
PACKAGES: Final = {
    "": ROOT / "scheduler" / "robotapp_scheduler",
    "op:": ROOT / "operator" / "robotapp_operator",
    "api:": ROOT / "crds" / "robotapp_api",
    "client:": ROOT / "client" / "robotapp_client",
    "claims:": ROOT / "claims" / "robotapp_claims",
}
"""How the page begins a path, and what it stands for."""
ROOMS: Final = (PACKAGES[""], PACKAGES["op:"], PACKAGES["client:"], PACKAGES["claims:"] / "protocol")
"""Where the old words must not be left without an explanation."""
HOUSE_WORDS: Final = """
    advice alike answers asked beside best bindsteps cluster collector confined death decision dialing doubts easy engine excess
    explaining feed finish flight flights front gate gated gather gathering groups guarded hintreads intake keys lazy least
    level loaded memory minds mirror narrowed needs news newest nodes nominated overdue parts patience placer posed posing
    promised published queuedpod refusals refused reserver resuming room shape shapes shares sight sound stamps strays sums
    together totals touchedby trial verdict verdicts versions vigil waitingroom waker wake whole wire wish
"""
"""Words of our own that Kubernetes' words have replaced (lower case, no underscores): where one is used again, the page tells why."""
REPLACED: Final = frozenset(HOUSE_WORDS.split())


class Entry(NamedTuple):
    """One row of a table: its words, and the files where they are defined."""

    words: tuple[str, ...]
    files: tuple[Path, ...]


def entries(text: str) -> Iterator[Entry]:
    for row in re.findall(r"^\| `.*", text, re.MULTILINE):
        cells = [cell.strip() for cell in row.strip("| ").split(" | ")]
        assert len(cells) == 4, row
        assert all(cells), row
        yield Entry(tuple(re.findall(r"`([^`]+)`", cells[0])), tuple(map(file_of, re.findall(r"`([^`]+)`", cells[2]))))


def file_of(where: str) -> Path:
    package, _, path = where.rpartition(":")
    return PACKAGES[package and f"{package}:"] / f"{path}.py"


@cache
def names(path: Path) -> frozenset[str]:
    """The classes of a file, and its own name as the page writes it."""
    if not path.is_file():
        return frozenset()
    found = {node.name for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ClassDef)}
    return frozenset({*found, f"{path.stem}/"})


def wrong(text: str) -> list[str]:
    """What the tables say and the code does not have."""
    found = []
    for entry in entries(text):
        found += [f"no file {path.name}" for path in entry.files if not path.is_file()]
        found += [f"{path.stem} has none of {entry.words}" for path in entry.files if not names(path) & {*entry.words}]
        found += [f"no {word} there" for word in entry.words if not any(word in names(path) for path in entry.files)]
    return found


def unexplained(text: str, files: list[Path]) -> list[tuple[str, str]]:
    """(file, name) of each old word that is the name of a module or class and missing in the tables at that file."""
    known = {(path, word) for entry in entries(text) for path in entry.files for word in entry.words}
    return [
        (path.relative_to(ROOT).as_posix(), name)
        for path in files
        for name in sorted(names(path))
        if re.sub("[_/]", "", name).lower() in REPLACED and (path, name) not in known
    ]


def explained_hooks(text: str) -> set[str]:
    table = text.partition("| the field's word | hook |")[2].partition("\n\n")[0]
    return set(re.findall(r"^\| [^|]+ \| `(\w+)` \|", table, re.MULTILINE))


def sources() -> list[Path]:
    return sorted(path for room in ROOMS for path in room.rglob("*.py"))


def test_every_word_of_the_glossary_is_a_class_or_module_where_the_page_says() -> None:
    text = GLOSSARY.read_text()
    assert len([*entries(text)]) > 80
    assert wrong(text) == []


def test_every_old_word_that_is_still_a_name_is_in_the_glossary() -> None:
    files = sources()
    assert len(files) > 300
    assert unexplained(GLOSSARY.read_text(), files) == []


def test_every_hook_and_fact_with_an_old_word_is_in_the_glossary() -> None:
    old = {name for name in (*HOOKS, *FEATURES) if name.replace("_", "") in REPLACED}
    assert old == explained_hooks(GLOSSARY.read_text())


def test_no_word_is_explained_twice_for_the_same_file() -> None:
    pairs = [
        (path, word)
        for entry in entries(GLOSSARY.read_text())
        for path in entry.files
        for word in entry.words
        if word in names(path)
    ]
    assert len(pairs) == len(set(pairs))


@pytest.mark.parametrize(
    ("row", "finding"),
    [
        ("| `Gone` | x | `core/runtime/ranking` | y |", "no Gone there"),
        ("| `TopRows` | x | `core/gone` | y |", "no file gone.py"),
        ("| `TopRows` | x | `core/runtime/ranking`, `core/nodes/columns` | y |", "columns has none of ('TopRows',)"),
        ("| `gone/` | x | `core/runtime/ranking` | y |", "no gone/ there"),
    ],
)
def test_a_row_that_names_what_is_not_there_is_found(row: str, finding: str) -> None:
    assert finding in wrong(row)


def test_a_page_without_a_word_that_is_still_used_is_found() -> None:
    path = PACKAGES[""] / "core" / "framework" / "plugin_calls.py"
    assert unexplained("", [path]) == [("scheduler/robotapp_scheduler/core/framework/plugin_calls.py", "Overdue")]
