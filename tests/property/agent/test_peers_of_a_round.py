"""Which nodes an agent probes: bounded, what is asked for first, every other zone in turn, the load spread over the nodes."""

from collections import Counter
from math import ceil

from hypothesis import given
from hypothesis import strategies as st

from robotapp_agent.probe.peers import MOST_ASKED, MOST_PEERS, OTHER_ZONES, OWN_ZONE, SMALL_ZONE, Peer, choose_peers

NAMES = [f"node-{index}" for index in range(40)]

clusters = st.dictionaries(
    st.sampled_from(NAMES), st.sampled_from(["", "a", "b", "c", "d", "e", "f", "g"]), max_size=40
)
own_names = st.sampled_from(NAMES)
asked_lists = st.lists(st.sampled_from([*NAMES, "gone"]), max_size=16)
rounds = st.integers(0, 10**9)


@given(own_names, clusters, asked_lists, rounds)
def test_peers_are_bounded_and_known_and_distinct_and_never_the_node_itself(
    own: str, zones: dict[str, str], asked: list[str], number: int
) -> None:
    names = [peer.name for peer in choose_peers(own, zones=zones, asked=asked, round_number=number)]
    assert len(names) <= MOST_PEERS
    assert len(set(names)) == len(names)
    assert set(names) <= zones.keys() - {own}


@given(own_names, clusters, asked_lists, rounds)
def test_what_is_asked_for_comes_first_and_in_every_round(
    own: str, zones: dict[str, str], asked: list[str], number: int
) -> None:
    wanted = set(asked) & zones.keys() - {own}
    peers = choose_peers(own, zones=zones, asked=asked, round_number=number)
    first = peers[: min(len(wanted), MOST_ASKED)]
    if len(wanted) <= MOST_ASKED or len(zones.keys() - {own}) <= MOST_PEERS:
        first = peers[: len(wanted)]
        assert set(first) == {Peer(name) for name in wanted}
        return
    following = choose_peers(own, zones=zones, asked=asked, round_number=number + 1)
    assert wanted <= {peer.name for peer in (*peers, *following)}
    assert all(peer.every_rounds == 2 for peer in first if peer.name in wanted)


@given(own_names, clusters, asked_lists, rounds, st.randoms())
def test_the_order_of_the_input_changes_nothing(
    own: str, zones: dict[str, str], asked: list[str], number: int, random: object
) -> None:
    shuffled = list(zones.items())
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert choose_peers(own, zones=zones, asked=asked, round_number=number) == choose_peers(
        own, zones=dict(shuffled), asked=asked[::-1], round_number=number
    )


@given(own_names, clusters, asked_lists, rounds)
def test_every_peer_comes_exactly_in_its_turn(own: str, zones: dict[str, str], asked: list[str], first: int) -> None:
    """`every_rounds` is what readers age an entry by: too small a number and it is unknown half of the time."""
    peers = {
        peer for turn in range(16) for peer in choose_peers(own, zones=zones, asked=asked, round_number=first + turn)
    }
    for peer in peers:
        came = [peer in choose_peers(own, zones=zones, asked=asked, round_number=first + turn) for turn in range(16)]
        turns = [turn for turn, present in enumerate(came) if present]
        assert turns == list(range(turns[0], 16, peer.every_rounds))


@given(own_names, clusters, asked_lists, rounds)
def test_every_other_zone_has_its_turn_within_as_many_rounds_as_there_are_zones(
    own: str, zones: dict[str, str], asked: list[str], first: int
) -> None:
    """Of clusters that small no zone is spared."""
    others = {zone for name, zone in zones.items() if zone != zones.get(own, "") and name != own}
    found = {
        zones[peer.name]
        for turn in range(3 * len(others))
        for peer in choose_peers(own, zones=zones, asked=asked, round_number=first + turn)
    }
    assert others <= found


@given(own_names, clusters, rounds)
def test_a_small_zone_is_measured_whole_and_a_larger_one_at_three_nodes(
    own: str, zones: dict[str, str], number: int
) -> None:
    near = {name for name, zone in zones.items() if zone == zones.get(own, "") and name != own}
    peers = choose_peers(own, zones=zones, asked=(), round_number=number)
    mine = {peer for peer in peers if peer.name in near}
    if len(zones.keys() - {own}) <= MOST_PEERS:
        assert mine == {Peer(name) for name in near}
        return
    assert mine == {Peer(name) for name in near} if len(near) <= SMALL_ZONE else len(mine) == OWN_ZONE
    assert len(peers) - len(mine) <= OTHER_ZONES


@given(own_names, clusters, asked_lists, rounds)
def test_a_small_cluster_is_measured_whole_in_every_round(
    own: str, zones: dict[str, str], asked: list[str], number: int
) -> None:
    others = zones.keys() - {own}
    peers = choose_peers(own, zones=zones, asked=asked, round_number=number)
    if len(others) <= MOST_PEERS:
        assert set(peers) == {Peer(name) for name in others}


def of_sizes(*sizes: int) -> dict[str, str]:
    return {f"{zone}-{index}": f"zone-{zone}" for zone, size in enumerate(sizes) for index in range(size)}


def busiest(zones: dict[str, str], *, rounds: int) -> float:
    """Probed by how many others per round, on average; the worst node."""
    probed = Counter(
        peer.name
        for number in range(rounds)
        for own in zones
        for peer in choose_peers(own, zones=zones, asked=(), round_number=number)
    )
    return max(probed.values()) / rounds


def test_no_node_is_probed_by_the_whole_cluster() -> None:
    """200 robots, and a cloud of two nodes that all of them need to know."""
    assert busiest(of_sizes(200, 2), rounds=7) <= 64


def test_a_zone_without_many_nodes_is_spared_and_still_comes_to_its_turn() -> None:
    zones = of_sizes(300, 1, 1)
    for own in ("0-0", "0-1", "0-2"):
        found = [
            peer
            for number in range(ceil(301 / 16))
            for peer in choose_peers(own, zones=zones, asked=(), round_number=number)
            if zones[peer.name] != "zone-0"
        ]
        assert {peer.name for peer in found} == {"1-0", "2-0"}


def test_a_node_that_joins_changes_the_peers_of_few() -> None:
    before = of_sizes(60, 60, 60)
    after = {**before, "new": "zone-1"}
    same = [
        choose_peers(own, zones=before, asked=(), round_number=0)
        == choose_peers(own, zones=after, asked=(), round_number=0)
        for own in before
    ]
    assert sum(same) >= 0.8 * len(same)


def test_representatives_of_a_zone_are_the_same_for_all_of_its_nodes() -> None:
    zones = of_sizes(48)
    found = {peer.name for own in zones for peer in choose_peers(own, zones=zones, asked=(), round_number=0)}
    assert len(found) == 4
