"""The probes of agents in network namespaces behind the latency switch: near ping in time, near the set loss, quick to notice.

Other programs of this machine can only make a figure worse, so the best of a few tries counts.
"""

from collections.abc import Iterator

import pytest

from campaigns.network.namespaced import TAP, skip_where_impossible
from campaigns.network.probes import Measured, ProbingNodes, is_as_ping, is_likely
from robotapp_agent.probe.rounds import LOSS_ROUNDS

pytestmark = pytest.mark.live
DELAYS_MS = {"b": 0, "c": 2, "d": 15, "e": 60}
TRIES = 8


@pytest.fixture(scope="module")
def nodes() -> Iterator[ProbingNodes]:
    skip_where_impossible()
    with ProbingNodes(["a", *DELAYS_MS], seed=11) as made:
        yield made


@pytest.fixture(autouse=True)
def clear_links(nodes: ProbingNodes) -> None:
    nodes.wire.switch.set_node("a", delay_ms=0, jitter_ms=0, loss=0, down=False)


def unreachable(measured: Measured) -> set[str]:
    return {peer for peer, result in measured.results.items() if result.p50_us is None and result.loss_ppm == 1_000_000}


def answering(measured: Measured) -> set[str]:
    return measured.results.keys() - unreachable(measured)


def test_the_median_is_that_of_ping_on_links_with_jitter_and_loss(nodes: ProbingNodes) -> None:
    for peer, delay_ms in DELAYS_MS.items():
        nodes.wire.switch.set_link("a", peer, delay_ms=delay_ms, jitter_ms=0.2 * delay_ms, loss=0.01)
    wrong = dict.fromkeys(DELAYS_MS, "not measured")
    for _ in range(TRIES):
        measured, ping_us = nodes.round_beside_ping("a", seconds=2)
        for peer, result in measured.results.items():
            if is_as_ping(result.p50_us, ping_us[peer]):
                wrong.pop(peer, None)
            elif peer in wrong:
                wrong[peer] = f"{result.p50_us} us, ping {ping_us[peer]:.0f} us"
        if not wrong:
            return
    raise AssertionError(wrong)


def lost_of(nodes: ProbingNodes, *, rounds: int) -> dict[str, tuple[int, int]]:
    """(lost, sent) by peer; what the status shows in the end is the same."""
    lost, sent = dict.fromkeys(DELAYS_MS, 0), dict.fromkeys(DELAYS_MS, 0)
    for _ in range(rounds):
        measured = nodes.round("a", seconds=1)
        for peer, result in measured.results.items():
            sent[peer] += result.sent
            lost[peer] += result.sent - result.answered
    for peer, result in measured.results.items():
        assert result.loss_ppm == pytest.approx(1e6 * lost[peer] / sent[peer], abs=1)
    return {peer: (lost[peer], sent[peer]) for peer in sent}


def test_losses_are_likely_for_what_is_set(nodes: ProbingNodes) -> None:
    shares = {"b": 0.0, "c": 0.01, "d": 0.05, "e": 0.2}
    for peer, share in shares.items():
        nodes.wire.switch.set_link("a", peer, loss=share, one_way=True)
    for _ in range(3):
        found = lost_of(nodes, rounds=LOSS_ROUNDS)
        assert not is_likely(*found["e"], 0.05), "twelve rounds cannot tell 20 % from 5 %"
        if found["b"][0] == 0 and all(is_likely(*found[peer], shares[peer]) for peer in "cde"):
            return
    raise AssertionError(found)


def test_a_link_that_goes_down_is_unreachable_within_three_rounds_and_measured_within_two_when_it_returns(
    nodes: ProbingNodes,
) -> None:
    assert any("b" in nodes.round("a", seconds=0.5).results for _ in range(TRIES))
    nodes.wire.switch.set_link("a", "b", down=True)
    first = nodes.round("a", seconds=0.5)
    assert first.silent == ("b",)
    assert any("b" in unreachable(nodes.round("a", seconds=0.5)) for _ in range(2))
    nodes.wire.switch.set_link("a", "b", down=False)
    assert any("b" in answering(nodes.round("a", seconds=0.5)) for _ in range(2))


def test_a_peer_is_measured_at_every_address_it_has_and_has_had_since_the_last_round(nodes: ProbingNodes) -> None:
    peer = nodes.wire.nodes["b"]
    for node, number in ((nodes.wire.nodes["a"], 1), (peer, 2)):
        node.run("sh", "-c", f"echo 0 > /proc/sys/net/ipv6/conf/{TAP}/disable_ipv6")
        node.run("ip", "address", "add", f"fd00:9::{number}/64", "dev", TAP, "nodad")
    peer.run("ip", "address", "add", "10.9.0.102/24", "dev", TAP)
    for address in ("10.9.0.102", "fd00:9::2", peer.address):
        rounds = (nodes.round("a", seconds=0.5, addresses={"b": address}) for _ in range(TRIES))
        assert any("b" in answering(measured) for measured in rounds), f"no answer from {address}"
    measured = nodes.round("a", seconds=0.5, addresses={"b": nodes.wire.nodes["c"].address})
    assert measured.silent == ("b",), "another node answered in its place"


def test_a_node_that_stands_still_is_unreachable_and_is_measured_when_it_goes_on(nodes: ProbingNodes) -> None:
    with nodes.nodes["b"].frozen():
        rounds = [nodes.round("a", seconds=0.5) for _ in range(3)]
    assert "b" in unreachable(rounds[-1])
    assert any("b" in answering(nodes.round("a", seconds=0.5)) for _ in range(TRIES))
