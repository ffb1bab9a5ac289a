"""CEL: values of expressions, and the errors of those that have none."""

from typing import Any

import pytest

from robotapp_api.values.cel import EvaluationError, ExpressionError, compile_expression
from robotapp_api.values.cel import parser as parser_module
from robotapp_api.values.cel.values import DefaultMap

INPUT = {
    "text": "lidar",
    "number": 5,
    "list": [3, 1, 2],
    "map": {"a": 1, "b": 2},
    "defaults": DefaultMap({"here": {"x": 1}}),
}


def evaluate(text: str) -> Any:
    return compile_expression(text, frozenset(INPUT)).evaluate(INPUT)


@pytest.mark.parametrize(
    "text",
    [
        "number == 5 && number == 5.0 && number != 5.1 && number < 5.5 && number >= 5u",
        "-7 / 2 == -3 && -7 % 4 == -3 && 7.0 / 2.0 == 3.5",
        "1 - 2 - 3 == -4 && 2 + 3 * 4 == 14 && (2 + 3) * 4 == 20",
        "-9223372036854775808 < 9223372036854775807 && 0xff == 255 && 1e3 == 1000.0 && - (-3) == 3",
        'text == "lidar" && text == \'lidar\' && r"\\d" == "\\\\d" && "\\u00e4\\x41\\101" == "äAA" && """a"b""" == "a\\"b"',
        'text.startsWith("li") && text.endsWith("ar") && text.contains("ida") && text.matches("^l.*r$")',
        'text.size() == 5 && size("äö") == 2 && text.charAt(0) == "l" && text.substring(1, 3) == "id"',
        '"a,b,,c".split(",") == ["a", "b", "", "c"] && "a,b,c".split(",", 2) == ["a", "b,c"] && ["a", "b"].join("-") == "a-b"',
        '"aXbX".replace("X", "-") == "a-b-" && "aXbX".replace("X", "-", 1) == "a-bX" && " a ".trim() == "a"',
        'text.indexOf("d") == 2 && text.lastIndexOf("x") == -1 && text.upperAscii() == "LIDAR"',
        'text.find("[a-d]+") == "da" && text.findAll("[a-i]", 2) == ["i", "d"]',
        '"%s: %d, %.1f, %x".format(["a", 3, 1.25, 255]) == "a: 3, 1.2, ff"',
        '"%s".format([[1, "a", true, null, {"k": 1.5}]]) == "[1, \\"a\\", true, null, {\\"k\\":1.500000}]"',
        "list.sum() == 6 && list.min() == 1 && list.max() == 3 && !list.isSorted() && list.sort() == [1, 2, 3]",
        "list.exists(x, x == 2) && list.all(x, x > 0) && list.exists_one(x, x > 2) && list.filter(x, x > 1) == [3, 2]",
        "list.map(x, x * 2) == [6, 2, 4] && list.map(x, x > 1, x) == [3, 2] && list.sortBy(x, -x) == [3, 2, 1]",
        "map.all(k, v, v > 0) && list.transformList(i, x, i + x) == [3, 2, 4] && map.transformMap(k, v, v * 2).b == 4",
        "[[1], [2, [3]]].flatten() == [1, 2, [3]] && [1, 1].distinct() == [1] && list.slice(0, 2) == [3, 1]",
        "sets.contains([1, 2], [2]) && sets.intersects([1], [1, 2]) && sets.equivalent([1, 1], [1])",
        '"a" in map && !("c" in map) && map.a == 1 && map["b"] == 2 && has(map.a) && !has(map.c)',
        'map.?a.orValue(0) == 1 && map.?c.orValue(7) == 7 && map[?"c"].hasValue() == false && map.?a.optMap(x, x + 1).value() == 2',
        '[?map.?c, 1] == [1] && {?"k": map.?a} == {"k": 1} && optional.none().or(optional.of(1)).value() == 1',
        'defaults["gone"] == {} && !("gone" in defaults) && defaults["here"].x == 1 && defaults["gone"].?x.orValue(3) == 3',
        "cel.bind(n, number * 2, n == 10 && n > number) && [1].exists(number, number == 1) && number == 5",
        'quantity("1Gi") == quantity("1024Mi") && quantity("1.5").isLessThan(quantity("2")) && quantity("2k").asInteger() == 2000',
        'quantity("1").add(1).sub(quantity("500m")).compareTo(quantity("1.5")) == 0 && isQuantity("1Gi") && !isQuantity("1Gib")',
        'semver("1.2.3-rc.1").isLessThan(semver("1.2.3")) && semver("1.2.3+b") == semver("1.2.3") && semver("v1.2", true).minor() == 2',
        'semver("1.0.0-alpha.2").isLessThan(semver("1.0.0-alpha.10")) && semver("1.0.0-1").isLessThan(semver("1.0.0-a"))',
        'type(1) == int && type(1u) == uint && type("a") == string && type(null) == null_type && type(int) == type',
        'int("12") == 12 && int(3.9) == 3 && double("1.5") == 1.5 && string(1.0) == "1" && bool("true") && uint(3) == 3u',
        'dyn(1) != "1" && null == null && 1 != true',
        "true || 1 / 0 == 1 || false",
        "!(1 / 0 == 1 && false)",
        "[0, 1].exists(x, 1 / x == 1) && ![1, 0, 2].all(x, 1 / x == 1)",
        "true ? number == 5 : 1 / 0 == 1  // a comment",
    ],
)  # fmt: skip
def test_expressions_have_the_values_of_cel_go(text: str) -> None:
    assert evaluate(text) is True


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("map.c == 1", "no such key: c"),
        ("text.size == 1", "no such key: size"),
        ("list[3] == 1", "index out of bounds: 3"),
        ("number / 0 == 1", "division by zero"),
        ("number % 0 == 1", "modulus by zero"),
        ("9223372036854775807 + number > 0", "integer overflow"),
        ("number + text == text", "no such overload"),
        ('number < "a"', "no such overload"),
        ("number && true", "no such overload"),
        ("number ? 1 : 2", "no such overload"),
        ("text.matches('(')", "Illegal regex"),
        ("optional.none().value()", "optional.none() dereference"),
        ("[].min() == 1", "min called on empty list"),
        ("text.charAt(6) == ''", "index out of range: 6"),
        ("quantity('1ZZ').isInteger()", "quantities must match"),
        ("semver('1.2').major() == 1", "No Major.Minor.Patch elements found"),
        ("{'a': 1, 'a': 2} == {}", "Failed with repeated key"),
        ("'%d'.format(['a']) == ''", "decimal clause can only be used on integers, was given string"),
    ],
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
