"""The watchman of the live tests must itself see what it is there to see."""

from typing import Any

import pytest

from campaigns.rigs.invariants import broken_rules
from robotapp_api.model.names import Annotation, Label

Object = dict[str, Any]


def pod(name: str, *, app: str = "app-1", node: str = "edge-1", devices: str = "", domain: str = "") -> Object:
    env = [{"name": "ROS_DOMAIN_ID", "value": domain}] if domain else []
    return {
        "metadata": {
            "name": name,
            "uid": f"uid-{name}",
            "labels": {Label.APP_UID: app},
            "annotations": {Annotation.GRANTED_DEVICES: devices} if devices else {},
        },
        "spec": {"nodeName": node, "containers": [{"env": env}]},
        "status": {"phase": "Running"},
    }


def device_claim(device: str = "can-can0", *, app: str = "app-1", node: str = "edge-1") -> Object:
    return {
        "metadata": {"name": f"{node}.{device}"},
        "spec": {"device": {"node": node, "id": device}, "holder": {"uid": app}},
    }


def domain_claim(number: int, *, app: str = "app-1") -> Object:
    return {"metadata": {"name": f"dds.{number}"}, "spec": {"domain": {"id": number}, "holder": {"uid": app}}}


def test_two_live_pods_of_one_component_on_one_device_are_seen() -> None:
    old, new = pod("driver-old", devices="can-can0"), pod("driver-new", devices="can-can0")
    (text,) = broken_rules([device_claim()], [old, new])
    assert text.startswith("edge-1/can-can0 is used by")
    assert "driver-old" in text
    assert "driver-new" in text


def test_a_terminating_pod_still_uses_its_device() -> None:
    old, new = pod("driver-old", devices="can-can0"), pod("driver-new", devices="can-can0")
    old["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    assert len(broken_rules([device_claim()], [old, new])) == 1


@pytest.mark.parametrize("phase", ["Succeeded", "Failed"])
def test_a_pod_that_ended_uses_nothing(phase: str) -> None:
    old, new = pod("driver-old", devices="can-can0"), pod("driver-new", devices="can-can0")
    old["status"]["phase"] = phase
    assert broken_rules([device_claim()], [old, new]) == []


def test_pods_of_one_app_share_its_domain_and_those_of_two_may_not() -> None:
    ours, peer, stranger = pod("a", domain="7"), pod("b", domain="7"), pod("c", app="app-2", domain="7")
    assert broken_rules([domain_claim(7)], [ours, peer]) == []
    unbacked, shared = broken_rules([domain_claim(7)], [ours, stranger])
    assert "c of ('app-2', '') runs with 7, which is claimed by ('app-1', '')" in unbacked
    assert shared.startswith("7 is used by")


def test_a_pod_with_a_device_that_nobody_or_somebody_else_claims_is_seen() -> None:
    for found in ([], [device_claim(app="app-2")]):
        (text,) = broken_rules(found, [pod("driver", devices="can-can0")])
        assert "driver of ('app-1', '') runs with edge-1/can-can0" in text


def bare(name: str, *, devices: str = "", domain: str = "") -> Object:
    """A pod without a RobotApp, with what the scheduler granted to it."""
    found = pod(name, devices=devices)
    del found["metadata"]["labels"]
    if domain:
        found["metadata"].setdefault("annotations", {})[Annotation.GRANTED_DOMAIN] = domain
    return found


def granted_domain(number: int, holder: str) -> Object:
    claim = domain_claim(number, app=holder)
    return claim | {"metadata": {"name": f"dds.default.c.{number}"}}


def test_a_bare_pod_is_the_holder_of_what_it_was_granted() -> None:
    one = bare("one", devices="can-can0", domain="7")
    mine = [device_claim(app="uid-one"), granted_domain(7, "uid-one")]
    assert broken_rules(mine, [one]) == []
    others = [device_claim(app="uid-two"), granted_domain(7, "uid-two")]
    assert len(broken_rules(others, [one])) == len(broken_rules([], [one])) == 2


def test_a_bare_pod_and_an_app_on_one_domain_are_seen() -> None:
    child = pod("child", domain="7")
    child["metadata"]["annotations"] = {Annotation.DOMAIN_CLAIM: "dds.default.c.7"}
    found = broken_rules([granted_domain(7, "uid-one")], [bare("one", domain="7"), child])
    assert any(text.startswith("dds.default.c.7 is used by") for text in found)


def test_a_pod_that_is_not_ours_may_join_any_domain() -> None:
    foreign = pod("foreign", domain="7")
    del foreign["metadata"]["labels"]
    assert broken_rules([granted_domain(7, "uid-one")], [foreign]) == []
