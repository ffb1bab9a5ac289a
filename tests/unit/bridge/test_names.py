"""The bridge and the profiler live without robotapp_api, so they have copies of its words, which are compared here."""

from typing import Any, get_args

import pytest
from tests.support.rigel.rigelfiles import orchestration, spec

from rigel_bridge import names as bridge
from rigel_bridge.document.distros import distros
from rigel_bridge.document.failures import control_character
from rigel_bridge.document.naming import MAX_APP_NAME, MAX_COMPONENT_NAME
from rigel_bridge.render import scheduling
from rigel_bridge.render.schema import robotapp_schema
from rigel_bridge.render.workloads import pod_annotations
from robotapp_api.model import names
from robotapp_api.model.app import component
from robotapp_api.values.devices.words import AGENT_TYPES
from robotapp_api.values.quantities.ranges import MAX_ID, is_safe_id
from robotapp_scheduler.core.api.ros import EXCLUSIVE_TYPES, TIERS
from ros_profile.knowledge import hardware
from ros_profile.main import CONTROL
from ros_profile.model.conclusions import Assessment, Hardware, QosClass
from ros_profile.output import hardware as held
from ros_profile.output import names as profiler
from ros_profile.output import values
from ros_profile.output.robotapp import needs


def fields(*path: str) -> Any:
    """The schema of a field of a RobotApp, below its spec."""
    found = robotapp_schema()["properties"]["spec"]
    for step in path:
        found = found["properties"][step] if step != "[]" else found["items"]
    return found


def test_objects_and_labels_have_the_names_of_the_api() -> None:
    assert bridge.API_VERSION == profiler.API_VERSION == names.API_VERSION
    assert bridge.MANAGER == names.BRIDGE_MANAGER
    assert (bridge.APP_LABEL, bridge.APP_UID_LABEL, bridge.COMPONENT_LABEL, bridge.INSTANCE_LABEL) == (
        names.Label.APP,
        names.Label.APP_UID,
        names.Label.COMPONENT,
        names.Label.INSTANCE,
    )
    assert (bridge.SCHEDULER, bridge.THESIS_SCHEDULER) == (names.SCHEDULER_NAME, names.THESIS_SCHEDULER_NAME)
    assert str(names.Annotation.GRANTED_DOMAIN) == bridge.GRANTED_DOMAIN


def test_annotations_of_pods_are_those_that_the_scheduler_reads() -> None:
    assert bridge.SCHEDULER_PREFIX == profiler.SCHEDULER_PREFIX
    described = {"policies": {"deadline": "1s"}, "devices": [{"type": "can"}], "sharedData": {"claimNames": ["c"]}}
    written = pod_annotations({"placement": {"masterNode": "n"}}, described, app="a")
    assert written.keys() == {
        names.Annotation.POLICIES,
        names.Annotation.TOPOLOGY,
        names.Annotation.AFFINITY,
        names.Annotation.SHARED_DATA,
    }


def test_qos_classes_have_one_order() -> None:
    by_tier = tuple(sorted(TIERS, key=lambda name: -TIERS[name]))
    assert bridge.QOS_CLASSES == tuple(QosClass) == by_tier == tuple(fields("components", "[]", "qosClass")["enum"])


def test_the_same_hardware_is_held_by_one_component_everywhere() -> None:
    assert held.EXCLUSIVE_TYPES == EXCLUSIVE_TYPES
    assert set(AGENT_TYPES) >= held.CLAIMED_TYPES > EXCLUSIVE_TYPES


OPENED = {"camera": "video", "usb": "input"}
"""Types of source that have another word in the API, for which an agent looks."""


@pytest.mark.parametrize("kind", sorted(set(AGENT_TYPES) - {"usb"}))
def test_a_rigelfile_and_a_profile_give_the_same_field_for_hardware(kind: str) -> None:
    """Twice the same: two devices, or one property of the node."""
    block = f"scheduler: {{affinity: {{hardware_requirements: [{{type: {kind}}}, {{type: {kind}}}]}}}}"
    (written,) = spec(orchestration(block))["components"]
    opened = next(
        (Hardware(source, model="joystick") for source, word in OPENED.items() if word == kind), Hardware(kind)
    )
    concluded = needs(Assessment(qos_class=None), [opened, opened])
    fields = {"devices", "requires"}
    assert {key: written[key] for key in fields & written.keys()} == concluded
    assert len(next(iter(concluded.values()))) == (2 if kind in held.CLAIMED_TYPES else 1)


def test_hardware_has_the_types_that_node_agents_report() -> None:
    assert {values.requirement(Hardware(kind))["type"] for kind in hardware.TYPES} <= set(AGENT_TYPES)


def test_tiers_are_those_of_runs_on() -> None:
    assert {tier for tiers in values.TIERS.values() for tier in tiers} == set(get_args(component.Tier))


def test_domains_that_everybody_may_ask_for_are_the_pools() -> None:
    assert bridge.MAX_DOMAIN == MAX_ID
    assert all(scheduling.is_default_domain(number) == is_safe_id(number) for number in range(MAX_ID + 2))


def test_bounds_are_those_of_the_schema() -> None:
    assert fields("components")["maxItems"] == profiler.MAX_COMPONENTS
    assert fields("edges")["maxItems"] == profiler.MAX_EDGES
    assert fields("components", "[]", "name")["maxLength"] <= MAX_COMPONENT_NAME
    assert MAX_APP_NAME == profiler.MAX_APP_NAME


def test_both_programs_keep_the_same_characters_from_the_terminal() -> None:
    every = [chr(number) for number in range(0x10000)]
    refused = {character for character in every if control_character(character)}
    assert {character for character in every if CONTROL.match(character)} == refused - {"\n"}


def test_the_distributions_of_ros_1_are_those_of_the_table() -> None:
    assert {each.name for each in distros().values() if each.version == 1} == profiler.ROS1_DISTROS


@pytest.mark.parametrize(
    ("opened", "claimed"),
    [
        (Hardware("camera"), {"devices": [{"name": "video", "type": "video"}]}),
        (Hardware("usb", model="joystick"), {"devices": [{"name": "input", "type": "input"}]}),
        (Hardware("usb"), {}),
    ],
)
def test_what_source_opens_is_claimed_and_a_bare_usb_device_is_not(
    opened: Hardware, claimed: dict[str, object]
) -> None:
    """A Rigelfile may state any USB device, because its author may have only one; source shows that one is opened, not which."""
    assert needs(Assessment(qos_class=None), [opened]) == claimed
