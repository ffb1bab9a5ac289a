"""The models as their users meet them: wire names, defaults, tolerance, round trips."""

from typing import Any

import pytest
from pydantic import ValidationError
from tests.support.apiobjects import ROS

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.base import dump
from robotapp_api.model.claim import RobotClaim
from robotapp_api.model.pool import DomainPool


def app(**spec: Any) -> dict[str, Any]:
    return {
        "metadata": {"name": "teleop"},
        "spec": {"ros": ROS, "components": [{"name": "driver", "image": "i"}], **spec},
    }


def test_the_minimal_object_needs_a_distribution_a_name_and_an_image() -> None:
    spec = RobotApp.model_validate(app()).spec
    assert (spec.ros.version, spec.components[0].runs_on, spec.scheduler_name) == (None, (), None)
    assert spec.ros2 is None
    assert spec.components[0].on_disconnect is None
    with pytest.raises(ValidationError, match="image"):
        RobotApp.model_validate(app(components=[{"name": "driver"}]))
    with pytest.raises(ValidationError, match="distro"):
        RobotApp.model_validate(app(ros={}))
    with pytest.raises(ValidationError, match="ros"):
        RobotApp.model_validate({"spec": {"components": [{"name": "driver", "image": "i"}]}})


def test_a_new_app_has_all_seven_conditions_as_unknown() -> None:
    status = RobotApp.model_validate(app()).status
    assert [c.type for c in status.conditions] == [
        "Ready", "Accepted", "Allocated", "Placed", "BudgetMet", "Progressing", "Stalled",
    ]  # fmt: skip
    assert {c.status for c in status.conditions} == {"Unknown"}


def test_python_keywords_keep_their_wire_names() -> None:
    wire = app(
        edges=[{"kind": "Topic", "topic": "/cmd_vel", "from": "driver", "to": "@robot"}],
        placement={"reschedule": {"for": "20s"}},
        components=[{"name": "driver", "image": "i", "sharedData": {"with": ["driver"]}}],
    )
    spec = RobotApp.model_validate(wire).spec
    assert spec.edges[0].from_ == "driver"
    assert spec.placement.reschedule.for_ == "20s"
    dumped = dump(spec)
    assert dumped["edges"] == wire["spec"]["edges"]
    assert dumped["components"][0]["sharedData"] == {"with": ["driver"]}


def test_fields_of_a_newer_schema_are_ignored() -> None:
    assert RobotApp.model_validate(app(hoverboards=7)) == RobotApp.model_validate(app())


def test_core_fields_are_kept_as_written_with_their_empty_objects() -> None:
    volumes = [{"name": "tmp", "emptyDir": {}}]
    component = {"name": "a", "image": "i", "template": {"spec": {"volumes": volumes}}}
    parsed = RobotApp.model_validate(app(components=[component]))
    assert dump(parsed)["spec"]["components"][0]["template"]["spec"]["volumes"] == volumes


def test_dump_writes_no_nulls_and_no_lists_nobody_wrote() -> None:
    dumped = dump(RobotApp.model_validate(app(edges=[])))
    assert dumped["spec"]["edges"] == []
    assert "devices" not in dumped["spec"]["components"][0]
    assert "ros2" not in dumped["spec"]
    assert dumped["metadata"] == {"name": "teleop"}


def test_dump_and_parse_are_inverse() -> None:
    first = RobotApp.model_validate(app(ros2={"domain": 7}, robots={"nodeSelector": {"matchLabels": {"a": "b"}}}))
    assert dump(RobotApp.model_validate(dump(first))) == dump(first)


def test_a_pool_without_a_quota_has_no_limit_and_zero_means_none() -> None:
    assert DomainPool.model_validate({"spec": {}}).spec.quota.default is None
    written = DomainPool.model_validate({"spec": {"quota": {"default": 0, "namespaces": {"team-a": 0}}}}).spec.quota
    assert (written.default, written.namespaces) == (0, {"team-a": 0})


def test_a_parameter_file_keeps_the_text_ros_reads() -> None:
    written = [{"inline": "/**: {ros__parameters: {gain: 1.0}}"}]
    parsed = RobotApp.model_validate(app(components=[{"name": "a", "image": "i", "parameters": written}]))
    assert dump(parsed)["spec"]["components"][0]["parameters"] == written


def test_models_are_frozen() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        RobotApp.model_validate(app()).spec.suspend = True  # type: ignore[misc]  # the point of the test


def test_claims_are_reserved_until_somebody_says_otherwise() -> None:
    holder = {"apiVersion": "v1", "kind": "Pod", "namespace": "n", "name": "p", "uid": "u"}
    claim = RobotClaim.model_validate(
        {"spec": {"domain": {"pool": "default", "scope": "Cluster", "id": 7}, "holder": holder}}
    )
    assert (claim.status.phase, claim.status.attempt, claim.spec.holder.instance) == ("Reserved", 0, "")
