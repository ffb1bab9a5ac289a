"""The rules of the definitions and the operator's checks, offline: what the API server says, at the line it is about."""

from typing import Any

import msgspec
import pytest
import yaml
from tests.support.apiobjects import app, component, edge, pool
from tests.support.wrong_input.rule_cases import CASES, RuleCase

from robotapp_api.model.names import Reason
from robotapp_claims.rules.objects import Pool
from robotapp_cli.lint.findings import Located, Severity
from robotapp_cli.lint.linter import lint
from robotapp_operator.plan.spec.validate import limit_note

KINDS = ("RobotApp", "DomainPool")
PARAMETERS = [pytest.param(case, id=f"{kind}: {case}") for kind in KINDS for case in CASES[kind] if case.before is None]
_OPERATORS = frozenset(Reason)
SERVERS = frozenset({"FieldValueInvalid", "FieldValueForbidden", "FieldValueRequired", "FieldValueDuplicate"})


def found(obj: dict[str, Any]) -> list[Located]:
    return lint(yaml.safe_dump(obj, sort_keys=False).encode()).findings


def errors(obj: dict[str, Any]) -> list[Located]:
    return [each for each in found(obj) if each.severity is Severity.ERROR]


@pytest.mark.parametrize("case", PARAMETERS)
def test_what_a_rule_refuses_is_refused_in_the_same_words_without_a_cluster(case: RuleCase) -> None:
    refusals = errors(case.bad)
    assert [each for each in refusals if each.message.endswith(case.says)], refusals


@pytest.mark.parametrize("case", PARAMETERS)
def test_what_the_api_server_accepts_breaks_no_rule_and_fits_the_schema(case: RuleCase) -> None:
    assert [each for each in found(case.good) if each.reason not in {*_OPERATORS, "Note"}] == []


def test_a_rule_points_at_the_field_it_is_about() -> None:
    text = """\
apiVersion: robotics.io/v1alpha1
kind: RobotApp
metadata: {name: teleop}
spec:
  ros: {distro: jazzy}
  ros2:
    pool: default
    domain: 150
  components:
  - {name: a, image: i}
  - name: b
    image: i
    replicas: 2
    devices: [{name: cam, type: video}]
"""
    places = {each.path: tuple(each.place) for each in lint(text.encode()).findings}
    assert places == {"spec.ros2.domain": (8, 13), "spec.components[1].replicas": (13, 15)}


def test_a_rule_about_a_default_points_at_what_is_nearest_to_it() -> None:
    (refusal,) = errors(app(ros1={"master": "External"}, ros={"distro": "noetic"}))
    assert refusal.path == "spec.ros1.uri"
    assert refusal.message.startswith("an External master needs its address")


def test_rules_are_not_applied_to_what_they_could_not_read_but_to_everything_else() -> None:
    broken = app(components=[component("a", replicas="two"), component("b", colocateWith=["b"])])
    messages = [each.message for each in errors(broken)]
    assert messages == [
        'must be a whole number, but is the text "two"',
        "component b names itself in colocateWith or separateFrom; remove it there",
    ]


def test_what_only_the_operator_refuses_is_found_with_its_reason() -> None:
    (refusal,) = errors(app(ros={"distro": "jazy"}))
    assert (refusal.path, refusal.reason) == ("spec.ros.distro", Reason.UNKNOWN_DISTRO)
    assert refusal.message == '"jazy" is no known ROS distribution; did you mean "jazzy"?'


def test_what_a_rule_has_said_the_operators_check_does_not_say_again() -> None:
    wrong = app(components=[component(env=[{"name": "ROS_DOMAIN_ID", "value": "7"}])])
    (refusal,) = errors(wrong)
    assert refusal.reason in SERVERS


def test_the_operators_checks_wait_until_the_spec_is_complete() -> None:
    wrong = app(ros={"distro": "jazy"}, components=[{"name": "a"}])
    assert [each.reason for each in errors(wrong)] == ["MissingField"]


def test_what_has_no_effect_yet_is_a_warning() -> None:
    (note,) = found(app(ros2={"transport": "SHM"}))
    assert (note.severity, note.path) == (Severity.WARNING, "spec.ros2.transport")
    assert "has no effect yet" in note.message


def test_what_reaches_the_node_is_a_warning_that_names_the_right() -> None:
    component = {"name": "a", "image": "x", "securityContext": {"privileged": True}}
    (note,) = found(app(components=[component]))
    assert (note.severity, note.path) == (Severity.WARNING, "spec.components[0].securityContext.privileged")
    assert "component a runs privileged: who applies it needs the verb use on robotapps/privileged" in note.message


def test_a_limit_of_a_pool_without_effect_is_a_warning_in_the_operators_words() -> None:
    (note,) = found(pool(maxParticipantsPerHost=20))
    assert (note.severity, note.path) == (Severity.WARNING, "spec.maxParticipantsPerHost")
    assert note.message == "20 has no effect yet; no pod is refused because of it"
    operators = limit_note(msgspec.convert({"metadata": {"name": "p"}, "spec": {"maxParticipantsPerHost": 20}}, Pool))
    assert operators == f"DomainPool p: {note.path} {note.message}"
    assert found(pool(maxParticipantsPerHost=50)) == found(pool()) == []


@pytest.mark.parametrize("shared", [{"name": "teleop"}, {"name": "teleop", "namespace": "default"}])
def test_an_app_that_shares_its_domain_with_itself_is_warned(shared: dict[str, str]) -> None:
    (note,) = found(app("teleop", ros2={"shareWith": [{"name": "other"}, shared]}))
    assert (note.severity, note.path) == (Severity.WARNING, "spec.ros2.shareWith[1]")
    assert note.message == "teleop is this app itself, so no domain is shared; write the name of the other app"


def test_an_app_of_the_same_name_in_another_namespace_is_another_app() -> None:
    assert found(app("teleop", ros2={"shareWith": [{"name": "teleop", "namespace": "other"}]})) == []


def test_contradicting_edges_are_found_at_the_edge() -> None:
    wrong = app(
        components=[component("a"), component("b"), component("c")],
        edges=[edge("a", "b", rateHz=20), edge("a", "c", rateHz="0.5")],
    )
    (refusal,) = errors(wrong)
    assert refusal.path == "spec.edges[1].rateHz"


@pytest.mark.parametrize(
    ("device", "field", "cure"),
    [
        ({"name": "bus", "type": "can"}, "type", "hostNetwork: true"),
        ({"name": "cam", "type": "video", "sharing": "Cluster"}, "sharing", "leave sharing out"),
    ],
)
def test_a_device_that_no_driver_hands_over_is_named_with_its_cure(
    device: dict[str, Any], field: str, cure: str
) -> None:
    (note,) = found(app(components=[component("a") | {"devices": [device]}]))
    assert (note.severity, note.path) == (Severity.WARNING, f"spec.components[0].devices[0].{field}")
    assert cure in note.message


@pytest.mark.parametrize(
    ("interface", "reason"),
    [
        ("/dev/ttyUSB0", "ttyUSB0 is a number in the order of plugging in"),
        ("/dev/serial/by-id/usb-FTDI_FT232R-if00-port0", "by-id/usb-FTDI_FT232R-if00-port0 is a link that udev makes"),
        (
            "/dev/v4l/by-path/pci-0000-video-index0",
            "is a link that udev makes, and agents publish no links; write usbID",
        ),
    ],
)
def test_an_interface_that_no_agent_publishes_is_a_warning(interface: str, reason: str) -> None:
    device = {"name": "port", "type": "serial", "interface": interface}
    findings = lint(yaml.safe_dump(app(components=[component(devices=[device])])).encode()).findings
    (finding,) = [one for one in findings if one.path.endswith(".interface")]
    assert finding.severity is Severity.WARNING
    assert reason in finding.message


@pytest.mark.parametrize(
    ("kind", "meant"), [("camra", "camera"), ("seriel", "serial"), ("viedo", "video"), ("tyt", ""), ("thermometer", "")]
)
def test_a_misspelt_type_of_device_is_asked_about_and_a_type_of_the_admins_own_rules_is_not(
    kind: str, meant: str
) -> None:
    device = {"name": "port", "type": kind}
    findings = lint(yaml.safe_dump(app(components=[component(devices=[device])])).encode()).findings
    messages = [one.message for one in findings if one.path.endswith(".type")]
    assert [f'did you mean "{meant}"?' in message for message in messages] == ([True] if meant else [])


@pytest.mark.parametrize("completion", [{}, {"completion": {}}])
def test_a_sweep_without_any_job_has_one_mistake(completion: dict[str, Any]) -> None:
    matrix = {"parameters": [{"name": "seed", "values": ["1", "2"]}]}
    (mistake,) = found(app(components=[component("sim")], matrix=matrix, **completion))
    assert "none has it" in mistake.message


@pytest.mark.parametrize("completion", [{}, {"completion": {}}])
def test_a_schedule_in_a_sweep_has_one_mistake_which_is_the_schedule(completion: dict[str, Any]) -> None:
    matrix = {"parameters": [{"name": "seed", "values": ["1", "2"]}]}
    nightly = component("sim", job={}, schedule={"cron": "@daily"})
    (mistake,) = found(app(components=[nightly], matrix=matrix, **completion))
    assert mistake.message.endswith("remove schedule, or matrix")


@pytest.mark.parametrize("status", ["Ready", "Complete"])
def test_a_component_that_waits_for_a_schedule_has_one_mistake_whatever_status_it_waits_for(status: str) -> None:
    nightly = component("backup", job={}, schedule={"cron": "@daily"})
    waiting = component("planner", dependsOn=[{"component": "backup", "status": status}])
    (mistake,) = found(app(components=[nightly, waiting]))
    assert '["backup"]' in mistake.message
    assert "write that status" not in mistake.message
