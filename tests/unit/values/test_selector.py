from typing import Any

import msgspec
import pytest

from robotapp_api.values.selector import integer, matches_labels, matches_node_terms
from robotapp_scheduler.core.api.core_v1 import NodeSelectorTerm

Json = dict[str, Any]
LABELS = {"zone": "a", "rank": "7", "empty": ""}


def term(*expressions: Json, fields: list[Json] | None = None) -> NodeSelectorTerm:
    return msgspec.convert({"matchExpressions": list(expressions), "matchFields": fields or []}, NodeSelectorTerm)


def expression(key: str, operator: str, *values: str) -> Json:
    return {"key": key, "operator": operator, "values": list(values)}


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (expression("zone", "In", "b", "a"), True),
        (expression("zone", "In", "b"), False),
        (expression("absent", "In", "a"), False),
        (expression("zone", "NotIn", "a"), False),
        (expression("absent", "NotIn", "a"), True),
        (expression("empty", "Exists"), True),
        (expression("absent", "DoesNotExist"), True),
        (expression("rank", "Gt", "6"), True),
        (expression("rank", "Gt", "7"), False),
        (expression("rank", "Lt", "+8"), True),
        (expression("zone", "Gt", "1"), False),
        (expression("rank", "Gt", "6.5"), False),
        (expression("zone", "In"), False),
        (expression("zone", "Like", "a"), False),
    ],
)
def test_an_expression_matches_as_upstream_reads_it(found: Json, expected: bool) -> None:
    assert matches_node_terms([term(found)], LABELS, "n1") is expected


def test_an_empty_term_matches_nothing_and_no_term_matches_nothing() -> None:
    assert not matches_node_terms([term()], LABELS, "n1")
    assert not matches_node_terms([], LABELS, "n1")


def test_expressions_are_anded_and_terms_are_ored() -> None:
    both = term(expression("zone", "In", "a"), expression("rank", "Gt", "9"))
    assert not matches_node_terms([both], LABELS, "n1")
    assert matches_node_terms([both, term(expression("zone", "Exists"))], LABELS, "n1")


def test_an_invalid_term_does_not_spoil_the_others() -> None:
    assert matches_node_terms([term(expression("rank", "Gt", "x")), term(expression("zone", "Exists"))], LABELS, "n1")


def test_fields_know_the_node_name_only() -> None:
    named = {"key": "metadata.name", "operator": "In", "values": ["n1"]}
    assert matches_node_terms([term(fields=[named])], {}, "n1")
    assert not matches_node_terms([term(fields=[named])], {}, "n2")
    assert not matches_node_terms([term(fields=[{**named, "key": "spec.x"}])], {}, "n1")


@pytest.mark.parametrize("text", ["", "-", "1_000", " 1", "1e3", "9223372036854775808", "1" * 40, "٣"])
def test_what_go_does_not_parse_is_no_integer(text: str) -> None:
    assert integer(text) is None


@pytest.mark.parametrize(
    ("selector", "expected"),
    [
        (None, False),
        ({}, True),
        ({"matchLabels": {"zone": "a"}}, True),
        ({"matchLabels": {"zone": "b"}}, False),
        ({"matchExpressions": [expression("rank", "In", "7")]}, True),
        ({"matchExpressions": [expression("rank", "Gt", "6")]}, False),
        ({"matchExpressions": [expression("rank", "In")]}, False),
        ({"matchLabels": {"zone": "a"}, "matchExpressions": [expression("zone", "NotIn", "a")]}, False),
    ],
)
def test_label_selectors(selector: Json | None, expected: bool) -> None:
    assert matches_labels(selector, LABELS) is expected
