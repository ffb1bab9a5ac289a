"""Our evaluator of CEL and the API server's come to the same: the expressions of the unit tests as rules of a definition."""

from typing import Any

import pytest
from tests.support.scheduler.cel_cases import FAILING_EXPRESSIONS, TRUE_EXPRESSIONS

from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes.process import wait_until

pytestmark = pytest.mark.live

DEFINITIONS = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions"
PROBES = "/apis/cel.example.com/v1/probes"


def make_rule(expression: str) -> dict[str, Any]:
    """A rule whose variables are bound by macros, since definitions know `self` alone."""
    body = expression.partition("//")[0]
    for name, value in (
        ("map", '{"a": 1, "b": 2}'),
        ("list", "[3, 1, 2]"),
        ("number", "self.number"),
        ("text", "self.text"),
    ):
        body = f"[{value}].all({name}, {body})"
    return {"rule": body, "message": expression[:200]}


def make_definition(expressions: list[str]) -> dict[str, Any]:
    """A definition of probes with one rule per expression."""
    fields = {"text": {"type": "string", "maxLength": 10}, "number": {"type": "integer"}}
    spec = {
        "type": "object",
        "properties": fields,
        "x-kubernetes-validations": [make_rule(text) for text in expressions],
    }
    schema = {"openAPIV3Schema": {"type": "object", "properties": {"spec": spec}}}
    return {
        "apiVersion": "apiextensions.k8s.io/v1",
        "kind": "CustomResourceDefinition",
        "metadata": {"name": "probes.cel.example.com"},
        "spec": {
            "group": "cel.example.com",
            "names": {"kind": "Probe", "plural": "probes"},
            "scope": "Cluster",
            "versions": [{"name": "v1", "served": True, "storage": True, "schema": schema}],
        },
    }


def is_accepted(plane: ControlPlane, expression: str) -> bool:
    """Returns whether a rule may be so: its types must fit and its cost be bounded, which both are easier for devices."""
    try:
        plane.api.create(f"{DEFINITIONS}?dryRun=All", make_definition([expression]))
    except ApiStatusError as refusal:
        return refusal.status != 422
    return True


def create_probe(plane: ControlPlane) -> str:
    """Returns the server's objections to a probe."""
    probe = {
        "apiVersion": "cel.example.com/v1",
        "kind": "Probe",
        "metadata": {"name": "probe"},
        "spec": {"text": "lidar", "number": 5},
    }
    try:
        plane.api.create(f"{PROBES}?dryRun=All", probe)
    except ApiStatusError as refusal:
        return refusal.message
    return ""


def try_rules(plane: ControlPlane, expressions: list[str]) -> str:
    """Returns the server's answer to a probe of a definition with these rules."""
    definition = make_definition([*expressions, "false"])
    plane.api.create(DEFINITIONS, definition)
    try:
        # The last rule refuses every probe, so an answer that names it is by the rules of this definition.
        assert wait_until(lambda: "false" in create_probe(plane), timeout_s=20)
        return create_probe(plane)
    finally:
        plane.api.delete(f"{DEFINITIONS}/{definition['metadata']['name']}")
        assert wait_until(lambda: "false" not in create_probe(plane), timeout_s=20)


def test_what_is_true_for_us_is_true_for_the_api_server(control_plane: ControlPlane) -> None:
    expressions = [text for text in TRUE_EXPRESSIONS if is_accepted(control_plane, text)]
    assert len(expressions) > 20
    objections = try_rules(control_plane, expressions)
    assert [text for text in expressions if text[:100] in objections] == []


def test_what_fails_for_us_fails_for_the_api_server_in_the_same_words(control_plane: ControlPlane) -> None:
    failures = [(text, message) for text, message in FAILING_EXPRESSIONS if is_accepted(control_plane, text)]
    assert len(failures) > 5
    objections = try_rules(control_plane, [text for text, _ in failures])
    assert [message for _, message in failures if message not in objections] == []
