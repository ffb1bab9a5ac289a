"""Fields of a newer CRD are named in the app's status by an operator that does not have them."""

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.factories import app_body

from robotapp_operator.plan.spec.record import parse_record
from robotapp_operator.plan.spec.unknown_fields import MOST
from robotapp_operator.plan.spec.validate import notes_of

EXAMPLES = Path(__file__).parents[4] / "examples"
APPS = [
    pytest.param(document, id=f"{path.relative_to(EXAMPLES)}-{index}")
    for path in sorted(EXAMPLES.rglob("*.yaml"))
    for index, document in enumerate(yaml.safe_load_all(path.read_text()))
    if isinstance(document, dict) and document.get("kind") == "RobotApp"
]


def find_unknown(body: dict[str, Any]) -> tuple[str, ...]:
    app = parse_record(body).app
    assert app is not None
    return app.unknown_fields


@pytest.mark.parametrize("document", APPS)
def test_no_field_of_the_examples_is_unknown(document: dict[str, Any]) -> None:
    assert find_unknown(document) == ()


def test_fields_of_a_later_version_are_found_wherever_they_are_each_once() -> None:
    body = app_body()
    body["spec"]["later"] = 1
    body["spec"]["placement"] = {"zones": ["hall-1"], "sooner": {"deep": 1}}
    for component in body["spec"]["components"]:
        component |= {"later": "x", "runsOn": ["Robot"], "env": [{"name": "A", "unheardOf": 1}]}
    assert set(find_unknown(body)) == {"spec.later", "spec.placement.sooner", "spec.components[].later"}


def test_there_is_an_end_to_the_list() -> None:
    body = app_body()
    body["spec"] |= {f"later{number}": 1 for number in range(100)}
    assert len(find_unknown(body)) == MOST


def test_the_status_names_them_and_the_cure() -> None:
    body = app_body()
    known = parse_record(copy.deepcopy(body)).app
    body["spec"]["later"] = 1
    app = parse_record(body).app
    assert known is not None
    assert app is not None
    (note,) = set(notes_of(app)) - set(notes_of(known))
    assert note == (
        "spec.later: without effect, because this operator is older than the CRD that has it: "
        "run the operator of that version, or remove what you wrote there"
    )
