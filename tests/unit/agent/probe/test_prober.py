from tests.support.probes import TIMEOUT_NS, prober, request_of, responder

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.prober import Prober

MS = 1_000_000


def answered(sender: Prober, *, sent_ns: int = 0, peer: str = "b") -> bytes:
    reply = responder(peer).answer(request_of(sender, peer, at_ns=sent_ns), source="10.0.0.1")
    assert reply
    return reply


def test_a_round_trip_lasts_from_sending_to_receiving() -> None:
    sender = prober()
    reply = answered(sender, sent_ns=5 * MS)
    assert sender.receive(reply, now_ns=12 * MS, queued_ns=0, timeout_ns=TIMEOUT_NS)
    assert sender.finish() == {"b": [7000]}


def test_the_time_that_a_reply_waited_for_us_does_not_count() -> None:
    sender = prober()
    assert sender.receive(answered(sender), now_ns=12 * MS, queued_ns=4 * MS, timeout_ns=TIMEOUT_NS)
    assert sender.finish() == {"b": [8000]}


def test_a_wall_clock_that_jumped_changes_no_time() -> None:
    for queued_ns in (-3600_000 * MS, -1, 13 * MS, 3600_000 * MS):
        sender = prober()
        assert sender.receive(answered(sender), now_ns=12 * MS, queued_ns=queued_ns, timeout_ns=TIMEOUT_NS)
        assert sender.finish() == {"b": [12_000]}


def test_a_request_takes_one_reply() -> None:
    sender = prober()
    reply = answered(sender)
    assert sender.receive(reply, now_ns=1 * MS, queued_ns=0, timeout_ns=TIMEOUT_NS)
    assert not sender.receive(reply, now_ns=9 * MS, queued_ns=0, timeout_ns=TIMEOUT_NS)
    assert sender.finish() == {"b": [1000]}


def test_a_reply_after_the_timeout_is_lost() -> None:
    sender = prober()
    assert not sender.receive(answered(sender), now_ns=TIMEOUT_NS + 1, queued_ns=0, timeout_ns=TIMEOUT_NS)
    assert sender.finish() == {"b": [None]}


def test_a_reply_after_its_round_belongs_to_no_request() -> None:
    sender = prober()
    late = answered(sender)
    assert sender.finish() == {"b": [None]}
    request_of(sender)
    assert not sender.receive(late, now_ns=1, queued_ns=0, timeout_ns=TIMEOUT_NS)
    assert sender.finish() == {"b": [None]}


def test_a_reply_of_another_session_or_for_another_node_belongs_to_no_request() -> None:
    sender = prober()
    request_of(sender)
    for stranger in (prober(session=b"session2"), prober("c")):
        assert not sender.receive(answered(stranger), now_ns=1, queued_ns=0, timeout_ns=TIMEOUT_NS)
    assert sender.finish() == {"b": [None]}


def test_a_peer_cannot_answer_for_another() -> None:
    """Node c holds the key, too; it saw the request to b and sends the reply in its own name."""
    sender, twin = prober(), prober()
    request_of(sender, "b")
    reply_of_c = responder("c").answer(request_of(twin, "c"), source="10.0.0.1")
    assert reply_of_c
    assert not sender.receive(reply_of_c, now_ns=1, queued_ns=0, timeout_ns=TIMEOUT_NS)


def test_a_request_is_no_reply() -> None:
    sender = prober()
    assert not sender.receive(request_of(sender), now_ns=1, queued_ns=0, timeout_ns=TIMEOUT_NS)


def test_a_request_that_did_not_leave_is_no_loss() -> None:
    sender = prober()
    request = sender.request("b")
    assert request
    sender.sent(request, peer="b", at_ns=0)
    sender.not_sent(request)
    assert sender.finish() == {}


def test_round_trips_stand_in_the_order_of_the_requests() -> None:
    sender = prober()
    replies = [answered(sender, sent_ns=index * MS) for index in range(4)]
    for index in (3, 0, 2):
        assert sender.receive(replies[index], now_ns=(10 + index) * MS, queued_ns=index * MS, timeout_ns=TIMEOUT_NS)
    assert sender.finish() == {"b": [10_000, None, 8000, 7000]}


def test_without_a_key_there_is_no_request() -> None:
    assert prober(keys=KeyRing()).request("b") is None
