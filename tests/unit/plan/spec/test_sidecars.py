"""What lint and `Accepted` say of sidecars that do not hear their component."""

from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.spec import spec_notes

JAZZY = {"ros": {"distro": "jazzy"}}


def user(number: int) -> dict[str, Any]:
    return {"securityContext": {"runAsUser": number}}


def notes(own: dict[str, Any], sidecar: dict[str, Any], pod: dict[str, Any] | None = None, **spec: Any) -> list[str]:
    """About a component with this sidecar."""
    steps = [{"name": "bag", "image": "i", "restartPolicy": "Always", **sidecar}]
    part = component("driver", template={"spec": {"initContainers": steps, **(pod or {})}}, **own)
    return [str(note) for note in spec_notes(make_app(part, **{**JAZZY, **spec}).spec) if "runAsUser" in str(note)]


def test_a_sidecar_of_another_user_gets_no_messages_over_fast_dds_and_the_cure_is_named() -> None:
    (note,) = notes(user(1000), user(2000))
    assert "driver runs as user 1000 and bag as user 2000" in note
    assert "write the same user, or ros2.transport: UDP" in note
    (note,) = notes({}, user(2000))
    assert "driver runs as the user of its image and bag as user 2000" in note
    (note,) = notes({}, user(2000), pod=user(1000))
    assert "driver runs as user 1000 and bag as user 2000" in note


@pytest.mark.parametrize(
    ("own", "sidecar", "pod", "spec"),
    [
        ({}, {}, {}, {}),
        (user(1000), user(1000), {}, {}),
        ({}, {}, user(1000), {}),
        ({}, {**user(1000), "restartPolicy": None}, {}, {}),
        ({}, user(1000), {}, {"ros2": {"transport": "UDP"}}),
        ({}, user(1000), {}, {"ros2": {"rmw": "rmw_cyclonedds_cpp"}}),
        ({}, user(1000), {}, {"ros": {"distro": "noetic"}}),
        ({}, {**user(1000), "env": [{"name": "FASTDDS_BUILTIN_TRANSPORTS", "value": "UDPv4"}]}, {}, {}),
    ],
    ids=["images", "same", "of the pod", "a step that ends", "UDP", "Cyclone DDS", "ROS 1", "own transports"],
)
def test_nothing_is_said_where_they_hear_each_other_or_are_not_known_to_be_silent(
    own: dict[str, Any], sidecar: dict[str, Any], pod: dict[str, Any], spec: dict[str, Any]
) -> None:
    assert notes(own, sidecar, pod, **spec) == []
