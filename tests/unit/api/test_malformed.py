"""Wrong values are refused by the models too, with the field: what a command-line check can say without a cluster."""

import re

import pytest
from pydantic import ValidationError
from tests.support.schemas import broken_rules, with_defaults
from tests.support.wrong_input.malformed import full_app, full_sweep, is_borrowed, malformed_apps, unused_fields

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.base import dump
from robotapp_api.schema.crd import schema_of

SCHEMA = schema_of(RobotApp)
REFUSED = {"nodeName", "schedulerName", "restartPolicy", "resourceClaims", "schedulingGates", "ephemeralContainers"}


def test_the_full_app_uses_every_field_but_those_that_are_always_refused() -> None:
    assert set(unused_fields(SCHEMA)) == {f"spec.components[].template.spec.{field}" for field in REFUSED}


def test_the_full_app_breaks_no_rule_and_survives_a_round_trip() -> None:
    assert broken_rules(SCHEMA, full_app()) == []
    assert dump(RobotApp.model_validate(full_app()))["spec"] == with_defaults(SCHEMA, full_app())["spec"]


def test_the_sweep_breaks_no_rule() -> None:
    assert broken_rules(SCHEMA, full_sweep()) == []


def test_there_are_more_than_a_hundred_ways_to_be_wrong() -> None:
    assert len(malformed_apps(SCHEMA)) > 200


def test_the_model_refuses_wrong_values_of_our_own_fields_by_their_path() -> None:
    for case in malformed_apps(SCHEMA):
        wanted = tuple(int(step) if step.isdigit() else step for step in re.split(r"[.\[\]]+", case.field) if step)
        if is_borrowed(re.sub(r"[0-9]+(?=\])", "", case.field)):
            continue
        with pytest.raises(ValidationError) as refused:
            RobotApp.model_validate(case.obj)
        assert any(error["loc"][: len(wanted)] == wanted for error in refused.value.errors()), case.field
