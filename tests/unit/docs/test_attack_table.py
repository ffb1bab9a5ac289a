"""The table of attacks is as long as it must be, leaves no field out, and stands in docs/security.md as it is run."""

import re
from collections.abc import Iterator
from typing import Any, Final

from tests.live.attacks.table import ATTACKS, ESCALATIONS, GRANTS
from tests.live.attacks.table.attack import Json, merge_patch, steps
from tests.live.attacks.table.escalations import REFERENCES
from tests.live.attacks.table.forged_grants import GRANTED
from tests.live.attacks.table.page import PAGE, page

from robotapp_api.schema.crd import KINDS, schema_of

CREDENTIAL: Final = re.compile(r"secret$|secretKeyRef$|secretRef$|imagePullSecrets$|serviceAccountName$", re.IGNORECASE)


def paths(schema: Json, path: str = "") -> Iterator[str]:
    for key, member in schema.get("properties", {}).items():
        here = f"{path}.{key}" if path else key
        yield here
        yield from paths(member, here)
        yield from paths(member.get("items", {}), here)


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


def test_every_field_that_names_a_secret_or_an_account_is_attacked() -> None:
    """A field that a later Kubernetes brings fails here, until the policy and the table know it."""
    (robotapp,) = [model for model in KINDS if model.__name__ == "RobotApp"]
    named = {path for path in paths(schema_of(robotapp)) if path.startswith("spec.") and CREDENTIAL.search(path)}
    attacked = {
        found
        for attack in REFERENCES
        for path, value in attack.changes.items()
        for found in used(value, ".".join(step for step in steps(path) if isinstance(step, str)))
    }
    assert len(named) >= 9
    assert named - attacked == set()


def test_the_page_shows_the_table() -> None:
    text = PAGE.read_text()
    assert page(text) == text, "run python -m tests.live.attacks.table.page"


def test_a_patch_holds_what_differs_and_nothing_else() -> None:
    old = {"a": {"b": 1, "c": [1]}, "d": 2, "e": 3}
    assert merge_patch(old, {"a": {"b": 1, "c": [2]}, "d": 2, "f": {}}) == {"a": {"c": [2]}, "e": None, "f": {}}
    assert merge_patch(old, old) == {}


def test_a_path_has_steps_of_names_indices_and_keys_with_dots() -> None:
    assert steps('spec.a[0].labels."x.io/y"') == ["spec", "a", 0, "labels", "x.io/y"]
