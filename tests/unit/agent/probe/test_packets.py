import pytest
from tests.support.agent.probes import OTHER_SECRET, SECRET, SESSION, ring

from robotapp_agent.probe.keys import key_of
from robotapp_agent.probe.packets import (
    MOST_SESSIONS,
    REPLY,
    REQUEST,
    SIZE_BYTES,
    WINDOW,
    Packet,
    ReplayWindows,
    node_id,
    open_packet,
    seal,
)


def packet(sequence: int = 1, *, kind: int = REQUEST, sender: str = "a", session: bytes = SESSION) -> Packet:
    return Packet(kind, key_of(SECRET), node_id(sender), node_id("b"), session, sequence)


def test_a_sealed_packet_opens_as_what_it_was() -> None:
    assert open_packet(seal(packet()), kind=REQUEST, receiver=node_id("b"), keys=ring()) == packet()


def test_requests_and_replies_have_one_size() -> None:
    assert len(seal(packet())) == len(seal(packet(kind=REPLY))) == SIZE_BYTES == 78


def test_a_packet_opens_as_its_own_kind_for_its_own_receiver_and_with_its_own_key_only() -> None:
    data = seal(packet())
    assert open_packet(data, kind=REPLY, receiver=node_id("b"), keys=ring()) is None
    assert open_packet(data, kind=REQUEST, receiver=node_id("c"), keys=ring()) is None
    assert open_packet(data, kind=REQUEST, receiver=node_id("b"), keys=ring(OTHER_SECRET)) is None


def test_every_bit_counts() -> None:
    data = bytearray(seal(packet()))
    for bit in range(len(data) * 8):
        data[bit // 8] ^= 1 << bit % 8
        for kind in (REQUEST, REPLY):
            assert open_packet(bytes(data), kind=kind, receiver=node_id("b"), keys=ring()) is None
        data[bit // 8] ^= 1 << bit % 8


@pytest.mark.parametrize("data", [b"", b"\x01", seal(packet())[:-1], seal(packet()) + b"\x00"])
def test_other_sizes_do_not_open(data: bytes) -> None:
    assert open_packet(data, kind=REQUEST, receiver=node_id("b"), keys=ring()) is None


def test_a_number_counts_once_in_whatever_order_they_come() -> None:
    windows = ReplayWindows()
    order = [5, 7, 6, 5, 9, 7, 6, 8, 8]
    assert [windows.is_first(packet(each)) for each in order] == [
        True,
        True,
        True,
        False,
        True,
        False,
        False,
        True,
        False,
    ]


def test_what_is_older_than_the_first_of_a_session_counts_as_seen() -> None:
    windows = ReplayWindows()
    assert windows.is_first(packet(500))
    assert not any(windows.is_first(packet(each)) for each in range(500))


def test_what_is_older_than_the_window_counts_as_seen() -> None:
    windows = ReplayWindows()
    for each in (1, WINDOW + 2):
        assert windows.is_first(packet(each))
    assert not windows.is_first(packet(2))
    assert windows.is_first(packet(3))


def test_a_far_jump_ahead_is_one_step() -> None:
    windows = ReplayWindows()
    assert windows.is_first(packet(0))
    assert windows.is_first(packet((1 << 64) - 1))
    assert not windows.is_first(packet(0))


def test_sessions_and_senders_count_apart() -> None:
    windows = ReplayWindows()
    assert windows.is_first(packet())
    assert windows.is_first(packet(sender="c"))
    assert windows.is_first(packet(session=b"anotherS"))


def test_the_nonce_of_a_request_makes_no_session_of_its_own() -> None:
    windows = ReplayWindows()
    assert windows.is_first(packet(1, session=b"same0001"))
    assert not windows.is_first(packet(1, session=b"same0002"))
    assert windows.is_first(packet(2, session=b"same0003"))
    assert repr(windows) == "<ReplayWindows: 1 sessions>"


def test_the_sessions_kept_are_bounded_and_the_most_silent_goes_first() -> None:
    windows = ReplayWindows()
    assert windows.is_first(packet(1))
    for index in range(MOST_SESSIONS):
        assert windows.is_first(packet(1, session=index.to_bytes(4, "big") + b"nonc"))
        assert windows.is_first(packet(2 + index))
    assert repr(windows) == f"<ReplayWindows: {MOST_SESSIONS} sessions>"
    assert not windows.is_first(packet(1))
    assert windows.is_first(packet(1, session=bytes(4) + b"nonc"))
