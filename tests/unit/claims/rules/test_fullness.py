from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims.objects import app_holder, claim, device_claim, domain_claim

from robotapp_claims.rules.fullness import Fullness, fullness
from robotapp_claims.rules.identity import domain_spec
from robotapp_claims.rules.objects import Claim, Meta, Pool, PoolSpec


def pool(ids: str = "1-10", **spec: object) -> Pool:
    return Pool(metadata=Meta(name="default"), spec=PoolSpec(ids=ids, **spec))  # type: ignore[arg-type]  # a factory


def in_zone(zone: str, number: int) -> Claim:
    return claim(domain_spec(pool="zones", scope="Zone", scope_value=zone, domain_id=number, holder=app_holder()))


def test_reserved_and_shared_ids_are_no_capacity() -> None:
    found = fullness(pool(reserved=(2, 200), shared_ids="9-10"), [])
    assert (found.capacity, found.used) == (7, "0/7")


def test_other_pools_claims_and_devices_do_not_count_and_resting_ones_do() -> None:
    claims = [domain_claim(1), domain_claim(2, phase="Draining"), domain_claim(1, pool="other"), device_claim()]
    assert fullness(pool(), claims) == Fullness(capacity=10, claimed=2, resting=1, fullest=2)


def test_of_several_zones_the_fullest_is_shown() -> None:
    zones = Pool(metadata=Meta(name="zones"), spec=PoolSpec(scope="Zone", ids="1-3"))
    found = fullness(zones, [in_zone("a", 1), in_zone("a", 2), in_zone("b", 1)])
    assert (found.used, found.claimed) == ("2/3", 3)


@given(st.sets(st.integers(1, 10)))
def test_a_cluster_pool_is_as_full_as_it_has_claims(numbers: set[int]) -> None:
    assert fullness(pool(), map(domain_claim, numbers)).used == f"{len(numbers)}/10"
