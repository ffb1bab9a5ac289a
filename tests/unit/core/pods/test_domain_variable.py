"""ROS_DOMAIN_ID of a pod that asks for a domain holds what is granted, or the pod is refused with the line to write."""

from typing import Any

import pytest
from tests.support.scheduling import make_info

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.api.ros import InvalidAnnotation, RosRequest

GRANTED = f"metadata.annotations['{Annotation.GRANTED_DOMAIN}']"


def read_from(path: Any, domain: str = "auto", **annotations: str) -> RosRequest | InvalidAnnotation | None:
    """The request of a pod whose second container takes its domain from this field."""
    reader = {
        "name": "sim",
        "image": "a:1",
        "env": [{"name": "ROS_DOMAIN_ID", "valueFrom": {"fieldRef": {"fieldPath": path}}}],
    }
    info = make_info(
        "sim",
        containers=[{"name": "main", "image": "a:1"}, reader],
        annotations={str(Annotation.DDS_DOMAIN): domain, **annotations},
    )
    return info.ros_request


@pytest.mark.parametrize("path", [GRANTED, GRANTED.replace("'", '"'), "metadata.name", "spec.nodeName"])
def test_a_variable_that_holds_the_grant_or_no_annotation_at_all_is_taken(path: str) -> None:
    assert isinstance(read_from(path), RosRequest)


@pytest.mark.parametrize("key", ["granted.robotics.io/domain", "scheduler.robotics.io/dds-domain", "team/domain"])
def test_a_variable_from_another_annotation_is_refused_with_the_line_to_write(key: str) -> None:
    path = f"metadata.annotations['{key}']"
    refusal = read_from(path)
    assert isinstance(refusal, InvalidAnnotation)
    assert refusal.message == (
        f'annotation scheduler.robotics.io/dds-domain, field env ROS_DOMAIN_ID of container sim: fieldPath "{path}"'
        f" is not valid; allowed: {GRANTED}, where the scheduler writes the domain"
    )


def test_an_annotation_of_the_user_is_read_while_it_states_the_very_domain_that_is_asked_for() -> None:
    path = "metadata.annotations['team/domain']"
    assert isinstance(read_from(path, "7", **{"team/domain": "7"}), RosRequest)
    assert isinstance(read_from(path, "7", **{"team/domain": "8"}), InvalidAnnotation)


@pytest.mark.parametrize("path", [None, 7, {}, ["metadata.annotations['a']"], "metadata.annotations['" + "a" * 400])
def test_a_field_path_of_another_type_or_length_is_no_crash(path: Any) -> None:
    assert isinstance(read_from(path), RosRequest)


def test_a_pod_that_asks_for_no_domain_may_read_whatever_it_likes() -> None:
    variable = {"name": "ROS_DOMAIN_ID", "valueFrom": {"fieldRef": {"fieldPath": "metadata.annotations['team/id']"}}}
    info = make_info(
        containers=[{"name": "main", "image": "a:1", "env": [variable]}],
        annotations={str(Annotation.TOPOLOGY): '{"master_node": "edge-1"}'},
    )
    assert isinstance(info.ros_request, RosRequest)
