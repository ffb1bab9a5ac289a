import pytest
from tests.support.agent.probes import TIMEOUT_NS, prober, reply_of, request_of, responder, ring

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.packets import REPLY, REQUEST, Packet, node_id, open_packet, seal
from robotapp_agent.probe.prober import Prober

MS = 1_000_000
HOUR_MS = 3_600_000


def answered(sender: Prober, *, sent_ns: int = 0, peer: str = "b", held_ns: int = 0) -> bytes:
    return reply_of(responder(peer, clock_ns=lambda: held_ns), request_of(sender, peer, at_ns=sent_ns))


def received(sender: Prober, reply: bytes, *, at_ms: float = 1) -> bool:
    return sender.receive(reply, received_ns=int(at_ms * MS), timeout_ns=TIMEOUT_NS)


def test_a_round_trip_lasts_from_sending_to_receiving() -> None:
    sender = prober()
    assert received(sender, answered(sender, sent_ns=5 * MS), at_ms=12)
    assert sender.finish() == {"b": [7000]}


@pytest.mark.parametrize(("held_ms", "round_trip_ms"), [(0, 7), (0.3, 6.7), (1, 6), (5, 6), (HOUR_MS, 6)])
def test_what_the_peer_needed_to_answer_does_not_count_up_to_a_millisecond(
    held_ms: float, round_trip_ms: float
) -> None:
    """A peer that lies gets nearer by a millisecond at most."""
    sender = prober()
    assert received(sender, answered(sender, held_ns=int(held_ms * MS)), at_ms=7)
    assert sender.finish() == {"b": [round_trip_ms * 1000]}


def test_no_round_trip_is_below_zero() -> None:
    sender = prober()
    assert received(sender, answered(sender, held_ns=MS), at_ms=0.2)
    assert sender.finish() == {"b": [0]}


def test_a_reply_from_before_its_request_is_none() -> None:
    sender = prober()
    assert not received(sender, answered(sender, sent_ns=5 * MS), at_ms=4)
    assert sender.finish() == {"b": [None]}


def test_a_request_takes_one_reply() -> None:
    sender = prober()
    reply = answered(sender)
    assert received(sender, reply)
    assert not received(sender, reply, at_ms=9)
    assert sender.finish() == {"b": [1000]}


def test_a_reply_after_the_timeout_is_lost() -> None:
    sender = prober()
    assert not received(sender, answered(sender), at_ms=TIMEOUT_NS / MS + 1)
    assert sender.finish() == {"b": [None]}


def test_a_reply_after_its_round_belongs_to_no_request() -> None:
    sender = prober()
    late = answered(sender)
    assert sender.finish() == {"b": [None]}
    request_of(sender)
    assert not received(sender, late)
    assert sender.finish() == {"b": [None]}


def test_a_reply_of_another_session_or_for_another_node_belongs_to_no_request() -> None:
    sender = prober()
    request_of(sender)
    for stranger in (prober(secret=b"another start"), prober("c")):
        assert not received(sender, answered(stranger))
    assert sender.finish() == {"b": [None]}


def test_a_peer_cannot_answer_for_another() -> None:
    """Node c holds the key, too; it saw the request to b and sends the reply in its own name."""
    sender, twin = prober(), prober()
    request_of(sender, "b")
    reply_of_c = reply_of(responder("c"), request_of(twin, "c"))
    assert not received(sender, reply_of_c)


def forged(kind: int, *, sent: bytes, sender: str, receiver: str, sequence: int) -> bytes:
    """What node c, which holds the key, makes of a request that it got itself."""
    own = open_packet(sent, kind=REQUEST, receiver=node_id("c"), keys=ring())
    assert own is not None
    return seal(Packet(kind, own.key, node_id(sender), node_id(receiver), own.session, sequence))


def test_a_peer_cannot_reply_before_it_was_asked() -> None:
    """It sprayed replies to the next numbers, and the first that came after the request was sent made it look near."""
    sender = prober()
    first = open_packet(request_of(sender, "b"), kind=REQUEST, receiver=node_id("b"), keys=ring())
    assert first is not None
    early = [first._replace(kind=REPLY, sender=first.receiver, receiver=first.sender, sequence=n) for n in range(1, 9)]
    sender.finish()
    request_of(sender, "b")
    assert not any(received(sender, seal(reply), at_ms=0.1) for reply in early)
    assert sender.finish() == {"b": [None]}


def test_what_a_peer_was_sent_helps_it_to_answer_for_no_other() -> None:
    sender = prober()
    to_c = request_of(sender, "c")
    request_of(sender, "b")
    assert not received(sender, forged(REPLY, sent=to_c, sender="b", receiver="a", sequence=2))
    assert sender.finish() == {"c": [None], "b": [None]}


def test_what_a_peer_was_sent_helps_it_to_use_up_the_numbers_of_no_other() -> None:
    sender, end = prober(), responder("b")
    jump = forged(REQUEST, sent=request_of(sender, "c"), sender="a", receiver="b", sequence=2**63)
    end.answer(jump, source="10.0.0.3", received_ns=0)
    assert received(sender, reply_of(end, request_of(sender, "b")))


def test_a_request_is_no_reply() -> None:
    sender = prober()
    assert not received(sender, request_of(sender))


def test_a_request_that_did_not_leave_is_no_loss() -> None:
    sender = prober()
    assert sender.request("b")
    assert sender.finish() == {}


def test_round_trips_stand_in_the_order_of_the_requests() -> None:
    sender = prober()
    replies = [answered(sender, sent_ns=index * MS) for index in range(4)]
    for index in (3, 0, 2):
        assert received(sender, replies[index], at_ms=10)
    assert sender.finish() == {"b": [10_000, None, 8000, 7000]}


def test_without_a_key_there_is_no_request() -> None:
    assert prober(keys=KeyRing()).request("b") is None
