"""Every CEL rule accepts what it should, refuses what it should, and says what to write instead."""

import re

import pytest
from tests.support.schemas import SCHEMAS, all_rules, broken_rules
from tests.support.wrong_input.rule_cases import CASES, RuleCase

PARAMETERS = [pytest.param(kind, case, id=f"{kind}: {case}") for kind, cases in CASES.items() for case in cases]

IN_KUBERNETES_1_32 = {
    *("size", "has", "all", "exists", "exists_one", "map", "filter", "matches", "startsWith", "endsWith", "contains"),
    *("int", "string", "duration", "split", "replace", "substring", "indexOf", "lastIndexOf", "trim", "lowerAscii"),
    *("upperAscii", "format", "isSorted", "sets.contains"),
}
"""Functions and macros a rule may call: CEL's own, its string extension, and those Kubernetes adds, all old enough for
version 1.32. Others, such as flatten, came later, and an older server refuses the whole CRD."""


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
    advice = (
        "write",
        "drop",
        "remove",
        "need",
        "must",
        "delete",
        "create",
        "leave it out",
        "for example",
        "kubectl debug",
    )
    for rule in all_rules(SCHEMAS[kind]):
        assert any(word in rule["message"] for word in advice), rule["message"]


@pytest.mark.parametrize("kind", SCHEMAS)
def test_rules_call_only_what_kubernetes_1_32_knows(kind: str) -> None:
    expressions = [rule.get(key, "") for rule in all_rules(SCHEMAS[kind]) for key in ("rule", "messageExpression")]
    called = {name for text in expressions for name in called_in(text)}
    assert called <= IN_KUBERNETES_1_32


def called_in(expression: str) -> set[str]:
    """Names of the functions and macros an expression calls; what stands in its texts is none."""
    code = re.sub(r"'(?:[^'\\]|\\.)*'", "''", expression)
    return set(re.findall(r"(?:\bsets\.)?\b[A-Za-z_]+(?=\()", code))


def test_calls_are_found_in_code_and_not_in_texts() -> None:
    found = called_in("sets.contains(self.map(a, a.b), ['x(']) && 'flatten() of %s'.format([int(self.c)]).size() > 0")
    assert found == {"sets.contains", "map", "format", "int", "size"}
