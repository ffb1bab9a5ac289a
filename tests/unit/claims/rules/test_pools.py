from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims.objects import app_holder, claim, device_claim, domain_claim

from robotapp_api.model.names import Reason
from robotapp_api.values.quantities.ranges import format_ids, parse_ids
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.identity import domain_spec
from robotapp_claims.rules.objects import Claim, Pool, PoolMeta, PoolSpec
from robotapp_claims.rules.pools import (
    Fullness,
    fullness,
    listed_ids,
    pool_that_gives,
    refuse_overlap,
)


def pool(ids: str = "1-10", **spec: object) -> Pool:
    return Pool(metadata=PoolMeta(name="default"), spec=PoolSpec(ids=ids, **spec))  # type: ignore[arg-type]  # a factory


def in_zone(zone: str, number: int) -> Claim:
    return claim(domain_spec(pool="zones", scope="Zone", scope_value=zone, domain_id=number, holder=app_holder()))


def test_reserved_and_shared_ids_are_no_capacity() -> None:
    found = fullness(pool(reserved=(2, 200), shared_ids="9-10"), [])
    assert (found.capacity, found.used) == (7, "0/7")


def test_other_pools_claims_and_devices_do_not_count_and_resting_ones_do() -> None:
    claims = [domain_claim(1), domain_claim(2, phase="Draining"), domain_claim(1, pool="other"), device_claim()]
    assert fullness(pool(), claims) == Fullness(capacity=10, claimed=2, resting=1, fullest=2)


def test_of_several_zones_the_fullest_is_shown() -> None:
    zones = Pool(metadata=PoolMeta(name="zones"), spec=PoolSpec(scope="Zone", ids="1-3"))
    found = fullness(zones, [in_zone("a", 1), in_zone("a", 2), in_zone("b", 1)])
    assert (found.used, found.claimed) == ("2/3", 3)


@given(st.sets(st.integers(1, 10)))
def test_a_cluster_pool_is_as_full_as_it_has_claims(numbers: set[int]) -> None:
    assert fullness(pool(), map(domain_claim, numbers)).used == f"{len(numbers)}/10"


IDS = st.sets(st.integers(0, 12), max_size=6)
POOLS = st.lists(st.tuples(IDS, IDS, st.sampled_from(["", "yard"]), st.integers(1, 3)), min_size=1, max_size=4)


def pools_of(drawn: list[tuple[set[int], set[int], str, int]]) -> list[Pool]:
    """Pools of one or two networks; the last number is the second in which each was made."""
    return [
        Pool(
            metadata=PoolMeta(name=f"pool-{number}", creation_timestamp=f"2026-01-01T00:00:0{second}Z"),
            spec=PoolSpec(ids=format_ids(ids), shared_ids=format_ids(shared - ids), network=network),
        )
        for number, (ids, shared, network, second) in enumerate(drawn)
    ]


@given(POOLS, st.integers(0, 12), st.booleans())
def test_no_two_pools_of_a_network_give_the_same_id(
    drawn: list[tuple[set[int], set[int], str, int]], number: int, by_number: bool
) -> None:
    pools = pools_of(drawn)
    givers = [
        pool
        for pool in pools
        if (by_number or number in listed_ids(pool))
        and not refuse_overlap(
            DomainRequest(app_holder(), pool=pool.metadata.name, requested_id=number if by_number else None),
            pool,
            pools,
        )
    ]
    networks = [pool.spec.network for pool in givers]
    assert len(networks) == len(set(networks))


@given(POOLS)
def test_a_pool_alone_on_its_ids_gives_all_of_them(drawn: list[tuple[set[int], set[int], str, int]]) -> None:
    pools = pools_of(drawn)
    for pool in pools:
        others = [other for other in pools if other is not pool and other.spec.network == pool.spec.network]
        if not any(listed_ids(other) & listed_ids(pool) for other in others):
            request = DomainRequest(app_holder(), pool=pool.metadata.name)
            assert refuse_overlap(request, pool, pools) is None
            assert all(pool_that_gives(number, [pool, *others]) is pool for number in listed_ids(pool))


def test_the_younger_pool_gives_nothing_and_names_the_older_one_and_the_ids() -> None:
    older = Pool(
        metadata=PoolMeta(name="default", creation_timestamp="2026-01-01T00:00:00Z"), spec=PoolSpec(ids="1-50")
    )
    younger = Pool(
        metadata=PoolMeta(name="renamed", creation_timestamp="2026-01-01T00:00:01Z"), spec=PoolSpec(ids="40-60")
    )
    assert refuse_overlap(DomainRequest(app_holder()), older, [older, younger]) is None
    refusal = refuse_overlap(DomainRequest(app_holder(), pool="renamed"), younger, [older, younger])
    assert refusal is not None
    assert refusal.reason is Reason.POOL_OVERLAPS
    assert "DomainPool default (ids 40-50) of the same network" in refusal.message


@given(st.sets(st.integers(0, 232)))
def test_ids_are_written_as_they_are_read(numbers: set[int]) -> None:
    assert set(parse_ids(format_ids(numbers))) == numbers
