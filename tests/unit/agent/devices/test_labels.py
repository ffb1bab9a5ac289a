"""Devices as node labels: what others match on, valid whatever a device calls itself."""

import re

from hypothesis import given
from hypothesis import strategies as st
from tests.unit.agent.devices.host_files import devices as any_devices

from robotapp_agent.devices.device import Device
from robotapp_agent.devices.labels import MOST_LABELS, labels_of
from robotapp_api.values.naming import label_value

PREFIX = "hardware.robotics.io/"
CAMERA = Device(id="video-046d-082d-1", type="video", model="C920", names=("usb", "sensor-usb-cam"))
SOURCE = {f"{PREFIX}source": "telemetry"}


def test_a_device_is_found_by_type_id_and_each_of_its_names() -> None:
    names = ("video", "video-046d-082d-1", "usb", "sensor", "sensor-usb-cam")
    assert labels_of([CAMERA]) == {f"{PREFIX}{name}": "C920" for name in names} | SOURCE


def test_a_device_without_model_is_labelled_true_and_one_with_an_interface_by_it() -> None:
    bus = Device(id="can-1d50-606f-7", type="can", interface="can0")
    names = ("can", "can-can0", "can-1d50-606f-7")
    assert labels_of([bus]) == {f"{PREFIX}{name}": "true" for name in names} | SOURCE


def test_a_key_of_devices_of_two_models_tells_only_that_there_are_some() -> None:
    other = Device(id="video-8086-0b3a-2", type="video", model="D435i")
    labels = labels_of([CAMERA, other])
    assert labels[f"{PREFIX}video"] == "true"
    assert labels[f"{PREFIX}video-8086-0b3a-2"] == "D435i"
    assert labels_of([CAMERA, CAMERA])[f"{PREFIX}video"] == "C920"


def test_what_is_not_plugged_in_gives_no_label_and_nothing_gives_none_at_all() -> None:
    absent = Device(id="video-a", type="video", present=False)
    assert labels_of([]) == labels_of([absent]) == {}


@given(st.text())
def test_any_text_becomes_a_label_value(text: str) -> None:
    assert re.fullmatch(r"([A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?)?", label_value(text))


@given(st.lists(any_devices(), max_size=20))
def test_whatever_the_devices_are_the_labels_are_valid(devices: list[Device]) -> None:
    labels = labels_of(devices)
    assert len(labels) <= MOST_LABELS
    for key, value in labels.items():
        assert re.fullmatch(r"hardware\.robotics\.io/[A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?", key)
        assert re.fullmatch(r"[A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?", value)


def test_too_many_labels_leave_out_ids_and_never_a_type() -> None:
    devices = [Device(id=f"usb-{n:03}-a-b-c", type="usb", names=(f"kind{n}",)) for n in range(200)]
    labels = labels_of(devices)
    assert len(labels) == MOST_LABELS
    assert all(f"{PREFIX}kind{n}" in labels for n in range(200))
