import pytest
from tests.support.agent.probes import OTHER_SECRET, SECRET, prober, reply_of, request_of, responder, ring

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.packets import REPLY, node_id, open_packet
from robotapp_agent.probe.responder import REPLIES_AT_ONCE


def test_a_request_is_answered_with_as_many_bytes_that_its_sender_recognises() -> None:
    request = request_of(prober())
    reply = responder().answer(request, source="10.0.0.1", received_ns=0)
    assert reply is not None
    assert len(reply) == len(request)
    opened = open_packet(reply, kind=REPLY, receiver=node_id("a"), keys=ring())
    assert opened
    assert opened.sender == node_id("b")


def test_a_request_is_answered_once() -> None:
    request, end = request_of(prober()), responder()
    assert end.answer(request, source="10.0.0.1", received_ns=0)
    assert end.answer(request, source="10.0.0.1", received_ns=0) is None
    assert end.answer(request, source="10.0.0.66", received_ns=0) is None


def test_a_reply_is_not_answered() -> None:
    reply = responder().answer(request_of(prober()), source="10.0.0.1", received_ns=0)
    assert reply
    assert responder("a").answer(reply, source="10.0.0.2", received_ns=0) is None
    assert responder("b").answer(reply, source="10.0.0.2", received_ns=0) is None


def test_a_request_to_another_node_is_not_answered() -> None:
    assert responder("c").answer(request_of(prober()), source="10.0.0.1", received_ns=0) is None


def test_a_request_with_an_unknown_key_is_not_answered() -> None:
    assert responder().answer(request_of(prober(keys=ring(OTHER_SECRET))), source="10.0.0.1", received_ns=0) is None


def test_without_keys_nothing_is_answered() -> None:
    assert responder(keys=KeyRing()).answer(request_of(prober()), source="10.0.0.1", received_ns=0) is None


def test_a_reply_is_signed_with_the_key_of_its_request() -> None:
    sender = prober(keys=ring(SECRET))
    reply = responder(keys=ring(OTHER_SECRET, SECRET)).answer(request_of(sender), source="10.0.0.1", received_ns=0)
    assert reply
    assert sender.receive(reply, received_ns=1, timeout_ns=10)


def test_an_address_gets_so_many_replies_and_more_with_time() -> None:
    now_ns = 0
    end = responder(clock_ns=lambda: now_ns)
    sender = prober()

    def replies(count: int, source: str) -> int:
        return sum(end.answer(request_of(sender), source=source, received_ns=0) is not None for _ in range(count))

    assert replies(300, "10.0.0.1") == REPLIES_AT_ONCE
    assert replies(1, "10.0.0.2") == 1
    now_ns = 10**9
    assert replies(300, "10.0.0.1") == 100


@pytest.mark.parametrize(("received_us", "held_us"), [(0, 700), (100, 600), (900, 0)])
def test_a_reply_tells_how_long_its_request_was_held(received_us: int, held_us: int) -> None:
    end = responder(clock_ns=lambda: 700_000)
    reply = reply_of(end, request_of(prober()), received_ns=received_us * 1000)
    opened = open_packet(reply, kind=REPLY, receiver=node_id("a"), keys=ring())
    assert opened
    assert opened.held_us == held_us


def test_a_request_that_seems_to_have_waited_for_a_day_is_answered() -> None:
    reply_of(responder(clock_ns=lambda: 86_400 * 10**9), request_of(prober()))


def test_forged_requests_use_up_nothing_of_the_address_they_pretend_to_come_from() -> None:
    end, sender = responder(), prober()
    for _ in range(1000):
        end.answer(request_of(prober(keys=ring(OTHER_SECRET))), source="10.0.0.1", received_ns=0)
    assert end.answer(request_of(sender), source="10.0.0.1", received_ns=0)
