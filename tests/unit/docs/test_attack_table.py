"""The table of attacks is as long as it must be, leaves no field out, and stands in docs/security.md as it is run."""

from collections.abc import Iterator
from typing import Any

from tests.live.attacks.table import ATTACKS, ESCALATIONS, GRANTS
from tests.live.attacks.table.attack import merge_patch, steps
from tests.live.attacks.table.escalations import REFERENCES
from tests.live.attacks.table.forged_grants import GRANTED
from tests.live.attacks.table.lending import lending_paths, robotapp_spec
from tests.live.attacks.table.page import PAGE, page


def used(value: Any, path: str) -> Iterator[str]:
    """Paths below `path` of all that is in a value."""
    yield path
    if isinstance(value, dict):
        for key, member in value.items():
            yield from used(member, f"{path}.{key}")
    elif isinstance(value, list):
        for member in value:
            yield from used(member, path)


def test_there_are_as_many_kinds_as_the_page_promises_and_each_once() -> None:
    assert len(ESCALATIONS) >= 40
    assert len([attack for attack in GRANTS if any(GRANTED in path for path in attack.changes)]) >= 30
    assert len({attack.key for attack in ATTACKS}) == len(ATTACKS)
    assert len({attack.text for attack in ATTACKS}) == len(ATTACKS)


def test_every_field_that_lends_something_is_attacked() -> None:
    """A field that a later Kubernetes brings is none of the known ones, so it lends something until somebody says otherwise."""
    lending = set(lending_paths(robotapp_spec(), "spec"))
    attacked = {
        below
        for attack in REFERENCES
        for path, value in attack.changes.items()
        for below in used(value, ".".join(step for step in steps(path) if isinstance(step, str)))
    }
    assert len(lending) >= 15
    assert lending - attacked == set()


def test_the_page_shows_the_table() -> None:
    text = PAGE.read_text()
    assert page(text) == text, "run python -m tests.live.attacks.table.page"


def test_a_patch_holds_what_differs_and_nothing_else() -> None:
    old = {"a": {"b": 1, "c": [1]}, "d": 2, "e": 3}
    assert merge_patch(old, {"a": {"b": 1, "c": [2]}, "d": 2, "f": {}}) == {"a": {"c": [2]}, "e": None, "f": {}}
    assert merge_patch(old, old) == {}


def test_a_path_has_steps_of_names_indices_and_keys_with_dots() -> None:
    assert steps('spec.a[0].labels."x.io/y"') == ["spec", "a", 0, "labels", "x.io/y"]
