"""Which devices of running pods are gone, as far as their nodes' agents tell."""

import dataclasses
from typing import Any

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import make_app

from robotapp_claims.rules.instances import Instance
from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.spec.objects import Telemetry
from robotapp_operator.plan.status.conditions import allocated
from robotapp_operator.plan.status.device_loss import lost_devices, parse_record, record_text
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.troubled import troubled


def claim(device: str = "usb-cam", *, pod: str = "p", phase: str = "Reserved") -> Claim:
    holder = {"apiVersion": "v", "kind": "RobotApp", "namespace": "n", "name": "a", "uid": "u", "component": "driver"}
    thing = {"node": "amr", "type": "usb", "id": device}
    status = {"pod": pod, "phase": phase}
    return msgspec.convert(
        {"metadata": {"name": f"dev.{device}"}, "spec": {"device": thing, "holder": holder}, "status": status}, Claim
    )


def report(**devices: bool) -> dict[str, Telemetry]:
    listed = [{"id": name.replace("_", "-"), "type": "usb", "present": there} for name, there in devices.items()]
    return {"amr": msgspec.convert({"metadata": {"name": "amr"}, "status": {"devices": listed}}, Telemetry)}


def lost(found: Claim, telemetry: dict[str, Telemetry], **recorded: str) -> list[str]:
    names = {f"dev.{key.replace('_', '-')}": pod for key, pod in recorded.items()}
    return [device.device for device in lost_devices([found], telemetry, users=["p"], recorded=names)]


def test_a_device_that_is_listed_as_not_present_is_lost() -> None:
    assert lost(claim(), report(usb_cam=False)) == ["usb-cam"]
    assert lost(claim(), report(usb_cam=True)) == []


def test_of_what_no_agent_speaks_nothing_is_known_unless_it_was_lost_before() -> None:
    assert lost(claim(), {}) == []
    assert lost(claim(), report()) == []
    assert lost(claim(), report(), usb_cam="p") == ["usb-cam"]
    assert lost(claim(), report(), usb_cam="another pod") == []
    assert lost(claim(), report(usb_cam=True), usb_cam="p") == []


def test_a_device_that_no_running_pod_uses_is_nobodys_loss() -> None:
    assert lost(claim(pod=""), report(usb_cam=False)) == []
    assert lost(claim(pod="gone"), report(usb_cam=False)) == []
    assert lost(claim(phase="Draining"), report(usb_cam=False)) == []


@given(st.dictionaries(st.text(), st.text(), max_size=20))
def test_a_record_survives_being_written(recorded: dict[str, str]) -> None:
    assert parse_record(record_text(recorded)) == recorded


@given(st.one_of(st.text(), st.sampled_from(['{"a": 1}', "[]", "null", "[" * 10_000, '"x"'])))
def test_a_record_that_cannot_be_read_is_empty(text: str) -> None:
    assert all(isinstance(pod, str) for pod in parse_record(text).values())


def test_a_loss_is_told_in_the_condition_and_among_what_needs_somebody() -> None:
    devices = lost_devices([claim()], report(usb_cam=False), users=["p"], recorded={})
    instance = InstanceFacts(
        instance=Instance("amr", "amr", ""), components=(), devices_wanted=1, devices_held=1, domain=7, lost=devices
    )
    facts = AppFacts(app=make_app(), instances=(instance,), now="2026-01-01T00:00:00Z")
    verdict = allocated(facts)
    assert (verdict.status, verdict.reason) == ("False", "DeviceLost")
    text = "driver: device usb-cam on amr is gone: plug it in again; onLoss decides what happens to the pod"
    assert verdict.message == f"amr: {text}"
    near = "planner would have 2ms on edge-2, but placement.reschedule.when is Never"
    late: Any = dataclasses.replace(instance, components=(), stays=near)
    (item,) = troubled(dataclasses.replace(facts, instances=(late,)))
    assert item["message"] == text, "what is not moved for a budget is no matter of the device"
    up: Any = dataclasses.replace(instance, components=(), device_stays="no other node has such a device that is free")
    (item,) = troubled(dataclasses.replace(facts, instances=(up,)))
    assert (item["reason"], item["message"]) == ("DeviceLost", f"{text} (no other node has such a device that is free)")
