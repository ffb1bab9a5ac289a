"""CEL expressions and what becomes of them, for our evaluator and for the API server."""

from typing import Final

VARIABLES: Final = {"text": "lidar", "number": 5, "list": [3, 1, 2], "map": {"a": 1, "b": 2}}
"""Values that the expressions are about. Some use `defaults` as well, which only device selectors can have."""

# fmt: off
TRUE_EXPRESSIONS: Final = (
    "number == 5 && number == 5.0 && number < 5.5 && number >= 5u",
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
    "[[1], [2, 3]].flatten() == [1, 2, 3] && [1, 1].distinct() == [1] && list.slice(0, 2) == [3, 1]",
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
    'duration("1m30s") == duration("90s") && duration("1h") > duration("59m") && duration("1us") <= duration("1ms")',
    'string(1.0 / 0.0) == "+Inf" && string(-1.0 / 0.0) == "-Inf" && string(0.0 / 0.0) == "NaN"',
    'type(1) == int && type(1u) == uint && type("a") == string && type(null) == null_type && type(int) == type',
    'int("12") == 12 && int(3.9) == 3 && double("1.5") == 1.5 && string(1.0) == "1" && bool("true") && uint(3) == 3u',
    'dyn(1) != "1" && null == null && dyn(1) != true',
    "true || 1 / 0 == 1 || false",
    "!(1 / 0 == 1 && false)",
    "[0, 1].exists(x, 1 / x == 1) && ![1, 0, 2].all(x, 1 / x == 1)",
    "true ? number == 5 : 1 / 0 == 1  // a comment",
)
# fmt: on
FAILING_EXPRESSIONS: Final = (
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
    ("duration('soon') > duration('1s')", "type conversion error from 'string' to 'google.protobuf.Duration'"),
    ("optional.none().value()", "optional.none() dereference"),
    ("[].min() == 1", "min called on empty list"),
    ("text.charAt(6) == ''", "index out of range: 6"),
    ("quantity('1ZZ').isInteger()", "quantities must match"),
    ("semver('1.2').major() == 1", "No Major.Minor.Patch elements found"),
    ("'%d'.format(['a']) == ''", "decimal clause can only be used on integers, was given string"),
)
"""Expression and the error it ends with."""
