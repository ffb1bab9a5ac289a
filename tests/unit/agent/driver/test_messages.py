"""Protobuf by hand: what the kubelet sends is read, and whatever else comes never breaks anything but its call."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.agent.dra import Answer, answer_of, claim_reference, fields

from robotapp_agent.driver import messages


def test_claims_of_the_kubelet_are_read() -> None:
    message = claim_reference("one") + claim_reference("two", namespace="other")
    assert messages.decode_claims(message) == (
        messages.ClaimReference("fleet", "uid-of-one", "one"),
        messages.ClaimReference("other", "uid-of-two", "two"),
    )


def test_fields_of_later_versions_are_left_alone() -> None:
    later = bytes([0x7A, 1, 65, 0x78, 0x96, 0x01, 0x7D, 1, 2, 3, 4, 0x79, 1, 2, 3, 4, 5, 6, 7, 8])
    assert len(messages.decode_claims(later + claim_reference("one") + later)) == 1


def test_devices_and_errors_are_written_as_the_kubelet_reads_them() -> None:
    long_id = "devices.robotics.io/device=" + "x" * 300
    device = messages.DeviceAnswer("lidar", "robot-1", "serial-a", long_id)
    assert answer_of(messages.encode_prepared({"u": (device,)})) == Answer([long_id], "")
    assert answer_of(messages.encode_prepared({"u": "no such device"})) == Answer([], "no such device")


def test_a_claim_that_was_given_back_has_an_entry_without_error() -> None:
    (entry,) = fields(messages.encode_unprepared({"u": ""}))[1]
    assert fields(entry) == {1: [b"u"], 2: [b""]}


def test_plugin_info_names_what_the_driver_serves() -> None:
    info = messages.encode_plugin_info(kind="DRAPlugin", name="d", endpoint="/dra.sock", versions=["v1.DRAPlugin"])
    assert fields(info) == {1: [b"DRAPlugin"], 2: [b"d"], 3: [b"/dra.sock"], 4: [b"v1.DRAPlugin"]}


def test_registration_status_is_read() -> None:
    assert messages.decode_registration_status(b"\x08\x01") == messages.RegistrationStatus(True, "")
    assert messages.decode_registration_status(b"\x12\x02no") == messages.RegistrationStatus(False, "no")


@pytest.mark.parametrize("message", [b"\x0a", b"\x0a\x05ab", b"\x0b", b"\xff" * 12])
def test_a_torn_message_is_a_value_error(message: bytes) -> None:
    with pytest.raises(ValueError, match=r"message|wire type|number"):
        messages.decode_claims(message)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(message: bytes) -> None:
    with contextlib.suppress(ValueError):
        messages.decode_claims(message)
    with contextlib.suppress(ValueError):
        messages.decode_registration_status(message)
