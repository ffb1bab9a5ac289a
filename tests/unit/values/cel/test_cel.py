"""CEL: values of expressions, and the errors of those that have none."""

from typing import Any

import pytest
from tests.support.scheduler.cel_cases import FAILING_EXPRESSIONS, TRUE_EXPRESSIONS, VARIABLES

from robotapp_api.values.cel import EvaluationError, ExpressionError, compile_expression
from robotapp_api.values.cel import parser as parser_module
from robotapp_api.values.cel.values import DefaultMap

INPUT = {**VARIABLES, "defaults": DefaultMap({"here": {"x": 1}})}


def evaluate(text: str) -> Any:
    return compile_expression(text, frozenset(INPUT)).evaluate(INPUT)


@pytest.mark.parametrize(
    "text",
    TRUE_EXPRESSIONS,
)
def test_expressions_have_the_values_of_cel_go(text: str) -> None:
    assert evaluate(text) is True


@pytest.mark.parametrize(
    ("text", "message"),
    FAILING_EXPRESSIONS,
)
def test_expressions_without_a_value_fail_with_the_words_of_cel_go(text: str, message: str) -> None:
    with pytest.raises(EvaluationError) as failure:
        evaluate(text)
    assert message in str(failure.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the end of the text is not expected there"),
        ("1 +", "the end of the text"),
        ("a b", "character 3: 'b'"),
        ("foo", "undeclared reference to 'foo'"),
        ("text.foo()", "undeclared reference to 'foo'"),
        ("list.all(x)", "found no matching overload for 'all'"),
        ("list.all(x.y, true)", "must be a simple name"),
        ("size(1, 2)", "found no matching overload for 'size'"),
        ("'abc", "the string is not closed"),
        ("'\\q'", "invalid escape sequence"),
        ("9223372036854775808", "invalid int literal"),
        ("has(text)", "invalid argument to has() macro"),
        ("for == 1", "reserved identifier: for"),
        ("1 # 2", "'#' is not part of an expression"),
        ("(" * 60 + "1" + ")" * 60, "nested deeper than"),
        ("1" + " " * parser_module.MAX_LENGTH, "longer than"),
    ],
)
def test_what_is_no_expression_is_refused(text: str, message: str) -> None:
    with pytest.raises(ExpressionError) as failure:
        compile_expression(text, frozenset(INPUT))
    assert message in str(failure.value)


def test_a_pattern_that_would_take_for_ever_elsewhere_takes_no_time() -> None:
    assert evaluate(f'!"{"a" * 64}!".matches("^(a+)+$")')


@pytest.mark.parametrize(
    "text",
    [
        "lists.range(400).all(x, lists.range(400).all(y, x * y >= 0))",
        '"a".replace("a", "aaaaaaaaaa")' + '.replace("a", "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa")' * 8 + ".size() > 0",
        "lists.range(2000000).size() > 0",
    ],
)  # fmt: skip
def test_an_expression_that_grows_without_bound_is_cancelled(text: str) -> None:
    with pytest.raises(EvaluationError, match="actual cost limit exceeded"):
        evaluate(text)


def test_long_chains_are_no_trouble() -> None:
    assert evaluate(" + ".join(["1"] * 2000) + " == 2000")
    assert evaluate(" && ".join(["true"] * 1000))
