"""Quantities, with the official client's Decimal parser as oracle."""

import math
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kubernetes.utils.quantity import parse_quantity

from robotapp_api.values.quantities.quantity import INT64_MAX, parse_bytes, parse_milli

NUMBERS = st.from_regex(r"[0-9]{1,12}(\.[0-9]{1,9})?|\.[0-9]{1,9}", fullmatch=True)
SUFFIXES = st.sampled_from(["", "n", "u", "m", "k", "M", "G", "T", "P", "E", "Ki", "Mi", "Gi", "Ti", "Pi", "Ei"])


def rounded_up(value: Decimal) -> int:
    return min(math.ceil(value), INT64_MAX)


@given(NUMBERS, SUFFIXES)
def test_agrees_with_the_official_parser(number: str, suffix: str) -> None:
    exact = parse_quantity(number + suffix)
    assert parse_bytes(number + suffix) == rounded_up(exact)
    assert parse_milli(number + suffix) == rounded_up(exact * 1000)


@given(NUMBERS, st.integers(-20, 20), st.sampled_from("eE"))
def test_exponents_are_powers_of_ten(number: str, exponent: int, letter: str) -> None:
    assert parse_milli(f"{number}{letter}{exponent}") == rounded_up(Decimal(number).scaleb(exponent + 3))


@pytest.mark.parametrize(
    ("text", "milli"),
    [("100m", 100), ("0.5", 500), (2, 2000), ("1n", 1), ("-1.5", -1500), ("+1", 1000), ("1.", 1000), ("1E", INT64_MAX)],
)
def test_milli_examples(text: str | int, milli: int) -> None:
    assert parse_milli(text) == milli


@pytest.mark.parametrize(
    ("text", "whole"), [("1Ki", 1024), ("40M", 40_000_000), ("1.5", 2), ("512Mi", 512 * 2**20), ("1e3", 1000)]
)
def test_whole_examples(text: str, whole: int) -> None:
    assert parse_bytes(text) == whole


@pytest.mark.parametrize(
    "text", ["", ".", "m", "1 Gi", "1gi", "1Kb", "0x10", "1e", "1e9999", "--1", "\uff11", "1\n", "9" * 65]
)
def test_everything_else_is_refused_with_an_example_of_what_to_write(text: str) -> None:
    with pytest.raises(ValueError, match="write for example 500m"):
        parse_bytes(text)
