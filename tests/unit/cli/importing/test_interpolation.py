"""Variables of compose files and env files."""

import pytest

from robotapp_cli.importing.files.interpolation import InterpolationError, interpolate, parse_env_file


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("$A-${A}", "a-a"),
        ("${A:-x}${EMPTY:-x}${NONE:-x}", "axx"),
        ("${A-x}${EMPTY-x}${NONE-x}", "ax"),
        ("${A:+x}${EMPTY:+x}${NONE:+x}", "x"),
        ("${EMPTY+x}${NONE+x}", "x"),
        ("${NONE:-${A}/${NONE:-b}}", "a/b"),
        ("$$A $${A}", "$A ${A}"),
        ("echo $(id -u) 5$", "echo $(id -u) 5$"),
        ("${NONE}", ""),
        ("${NONE:?say it}", "CHOOSE-A-VALUE"),
        ("${A:?say it}", "a"),
    ],
)
def test_the_forms_of_the_specification(text: str, value: str) -> None:
    assert interpolate(text, {"A": "a", "EMPTY": ""}).value == value


def test_variables_without_a_value_are_named_once() -> None:
    assert interpolate("$B ${B} ${C:?} ${D:-d}", {}).unset == ("B", "C")


@pytest.mark.parametrize("text", ["${", "${A", "${}", "${A!b}", "${-x}"])
def test_what_is_no_variable_is_refused_with_the_cure(text: str) -> None:
    with pytest.raises(InterpolationError, match="write"):
        interpolate(text, {})


def test_a_chain_of_defaults_has_an_end() -> None:
    with pytest.raises(InterpolationError, match="deeper"):
        interpolate("${A:-" * 30 + "}" * 30, {})


def test_an_env_file() -> None:
    text = """
# comment
PLAIN=a b  # comment
export QUOTED="x\\ty $PLAIN"
RAW='$PLAIN # no comment'
EMPTY=
FROM_SHELL
COLON: value
LONG="first
second"
"""
    values = {line.name: line.text for line in parse_env_file(text, {"FROM_SHELL": "s"})}
    assert values == {
        "PLAIN": "a b",
        "QUOTED": "x\ty a b",
        "RAW": "$PLAIN # no comment",
        "EMPTY": "",
        "FROM_SHELL": "s",
        "COLON": "value",
        "LONG": "first\nsecond",
    }


@pytest.mark.parametrize("text", ["A B C\n", 'A="open\n'])
def test_an_env_file_that_cannot_be_read_names_the_line(text: str) -> None:
    with pytest.raises(InterpolationError, match="line 1"):
        list(parse_env_file(text, {}))
