"""What is reported from scan to scan: plugging after two scans, unplugging at once, remembered for an hour."""

import random

from hypothesis import given
from hypothesis import strategies as st

from robotapp_agent.devices.changes import KEEP_ABSENT_S, Presence
from robotapp_agent.devices.device import MOST_DEVICES, Device

CAMERA = Device(id="video-a", type="video", path="/dev/video0")
BUS = Device(id="can-can0", type="can", interface="can0")


def shown(presence: Presence) -> dict[str, bool]:
    return {device.id: device.present for device in presence.devices}


def test_the_first_scan_of_an_agent_is_believed() -> None:
    presence = Presence()
    presence.observe([CAMERA], now_s=0)
    assert shown(presence) == {"video-a": True}
    assert not presence.pending


def test_a_device_that_is_plugged_in_counts_at_the_second_scan() -> None:
    presence = Presence()
    presence.observe([], now_s=0)
    presence.observe([CAMERA], now_s=10)
    assert (shown(presence), presence.pending) == ({}, True)
    presence.observe([CAMERA], now_s=12)
    assert (shown(presence), presence.pending) == ({"video-a": True}, False)


def test_a_device_that_is_seen_now_and_then_is_never_reported() -> None:
    presence = Presence()
    presence.observe([], now_s=0)
    for number in range(20):
        presence.observe([CAMERA] if number % 2 else [], now_s=number)
        assert shown(presence) == {}


def test_a_device_that_is_unplugged_is_absent_at_once_and_forgotten_after_an_hour() -> None:
    presence = Presence()
    presence.observe([CAMERA, BUS], now_s=0)
    presence.observe([BUS], now_s=10)
    assert shown(presence) == {"video-a": False, "can-can0": True}
    presence.observe([BUS], now_s=10 + KEEP_ABSENT_S - 1)
    assert shown(presence) == {"video-a": False, "can-can0": True}
    presence.observe([BUS], now_s=10 + KEEP_ABSENT_S)
    assert shown(presence) == {"can-can0": True}


def test_a_device_that_returns_counts_again_at_its_second_scan() -> None:
    presence = Presence()
    presence.observe([CAMERA], now_s=0)
    presence.observe([], now_s=1)
    presence.observe([CAMERA], now_s=2)
    assert shown(presence) == {"video-a": False}
    presence.observe([CAMERA], now_s=3)
    assert shown(presence) == {"video-a": True}


def test_where_a_device_is_opened_is_told_as_soon_as_it_changes() -> None:
    presence = Presence()
    presence.observe([CAMERA], now_s=0)
    moved = Device(id="video-a", type="video", path="/dev/video4")
    assert presence.observe([moved], now_s=1) == (moved,)


def test_a_scan_that_could_not_read_everything_unplugs_nothing() -> None:
    presence = Presence()
    presence.observe([CAMERA, BUS], now_s=0)
    presence.observe([BUS], now_s=1, complete=False)
    assert shown(presence) == {"video-a": True, "can-can0": True}


def test_an_agent_that_restarts_still_knows_what_was_unplugged() -> None:
    presence = Presence(reported=[CAMERA, BUS], now_s=0)
    assert shown(presence) == {"video-a": True, "can-can0": True}, "as it was reported, until a scan tells"
    presence.observe([BUS], now_s=1)
    assert shown(presence) == {"video-a": False, "can-can0": True}


def test_a_first_scan_that_could_not_read_everything_unplugs_nothing_of_what_was_reported() -> None:
    presence = Presence(reported=[CAMERA], now_s=0)
    assert [device.present for device in presence.observe([], now_s=5, complete=False)] == [True]
    assert [device.present for device in presence.observe([], now_s=10)] == [False]


def test_no_more_devices_are_reported_than_the_api_takes_and_those_plugged_in_come_first() -> None:
    many = [Device(id=f"usb-{number:03}", type="usb") for number in range(MOST_DEVICES + 20)]
    presence = Presence(reported=many[:MOST_DEVICES], now_s=0)
    presence.observe(many[20:], now_s=1)
    assert shown(presence) == {device.id: True for device in many[20:]}
    presence.observe(many, now_s=2)
    presence.observe(many, now_s=3)
    assert shown(presence) == {device.id: True for device in many[20:]}
    assert presence.omitted == 20


def test_devices_without_room_are_the_same_at_every_scan() -> None:
    """They counted as new at every second scan: the report changed each time, and was written each time."""
    many = [Device(id=f"usb-{number:03}", type="usb") for number in range(MOST_DEVICES + 5)]
    presence, seen = Presence(), set()
    for now_s in range(6):
        presence.observe(many, now_s=now_s)
        seen.add((presence.omitted, presence.pending, len(presence.devices)))
    assert seen == {(5, False, MOST_DEVICES)}
    presence.observe(many[1:], now_s=7)  # room for one of them
    assert (presence.omitted, shown(presence)[many[MOST_DEVICES].id]) == (4, True)


def test_after_500_cycles_of_plugging_at_10_hz_the_report_is_right_at_rest() -> None:
    """A cable that is pulled and put back ten times a second while scans come at any moment."""
    choice = random.Random(14)
    devices = [Device(id=f"serial-{number}", type="serial") for number in range(6)]
    presence = Presence()
    presence.observe(devices, now_s=0)
    here = set(range(6))
    for cycle in range(500):
        here ^= {choice.randrange(6)}
        if choice.random() < 0.5:
            presence.observe([devices[number] for number in here], now_s=cycle / 10)
    for rest in (51, 53):
        presence.observe([devices[number] for number in here], now_s=rest)
    assert {name for name, present in shown(presence).items() if present} == {f"serial-{number}" for number in here}
    assert not presence.pending


@given(st.lists(st.tuples(st.sets(st.integers(0, 200), max_size=200), st.booleans()), max_size=8))
def test_any_row_of_scans_ends_in_what_is_there_within_the_bound(scans: list[tuple[set[int], bool]]) -> None:
    presence = Presence()
    for moment, (here, complete) in enumerate(scans):
        devices = presence.observe(
            [Device(id=f"usb-{number}", type="usb") for number in here], now_s=moment, complete=complete
        )
        assert len(devices) <= MOST_DEVICES
        assert [device.id for device in devices] == sorted({device.id for device in devices})
    last = [Device(id=f"usb-{number}", type="usb") for number in (scans[-1][0] if scans else ())]
    for moment in (10, 11):
        presence.observe(last, now_s=moment)
    present = {name for name, here in shown(presence).items() if here}
    assert present <= {device.id for device in last}
    assert len(present) == min(len(last), MOST_DEVICES)
