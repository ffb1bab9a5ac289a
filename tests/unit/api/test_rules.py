"""Every CEL rule accepts what it should, refuses what it should, and says what to write instead."""

import pytest
from tests.support.cel_rules import all_rules, broken_rules
from tests.support.rule_cases import CASES, RuleCase

from robotapp_api.schema.crd import KINDS, schema_of

SCHEMAS = {model.__name__: schema_of(model) for model in KINDS}
PARAMETERS = [pytest.param(kind, case, id=f"{kind}: {case}") for kind, cases in CASES.items() for case in cases]


@pytest.mark.parametrize(("kind", "case"), PARAMETERS)
def test_a_rule_accepts_the_good_and_refuses_the_bad_object(kind: str, case: RuleCase) -> None:
    before = () if case.before is None else (case.before,)
    assert broken_rules(SCHEMAS[kind], case.good, *before) == []
    broken = broken_rules(SCHEMAS[kind], case.bad, *before)
    assert [each.shown for each in broken if each.shown.endswith(case.says)], broken


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_rule_has_a_case_that_breaks_it(kind: str) -> None:
    broken = {
        each.message
        for case in CASES.get(kind, ())
        for each in broken_rules(SCHEMAS[kind], case.bad, *(() if case.before is None else (case.before,)))
    }
    assert {rule["message"] for rule in all_rules(SCHEMAS[kind])} == broken


@pytest.mark.parametrize("kind", SCHEMAS)
def test_messages_say_what_to_write_instead(kind: str) -> None:
    advice = ("write", "drop", "remove", "need", "must", "delete", "create")
    for rule in all_rules(SCHEMAS[kind]):
        assert any(word in rule["message"] for word in advice), rule["message"]
