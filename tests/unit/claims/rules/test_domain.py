import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims.objects import app_holder, deployment, domain_claim

from robotapp_api.model.names import Reason
from robotapp_claims.rules import domain
from robotapp_claims.rules.domain import DomainRequest, Fence, Step, plan_domain, wanted_id
from robotapp_claims.rules.identity import holder_of_pod, id_order
from robotapp_claims.rules.objects import Pool, PoolMeta, PoolQuota, PoolSpec

ids = st.sets(st.integers(1, 12), max_size=6)
requests = st.none() | st.integers(1, 12)
ASK = DomainRequest(app_holder())


def pool(ids: str = "1-3", **spec: object) -> Pool:
    return Pool(metadata=PoolMeta(name="default"), spec=PoolSpec(ids=ids, **spec))  # type: ignore[arg-type]  # a factory


@given(ids, ids, requests)
def test_the_wanted_id_is_held_acceptable_and_preferably_named(
    held: set[int], named: set[int], requested: int | None
) -> None:
    wanted = wanted_id(held=held, named=named, uid="u", instance="", requested=requested)
    acceptable = {number for number in held if requested in {None, number}}
    if wanted is None:
        assert not acceptable
    else:
        assert wanted in (acceptable & named or acceptable)


@given(ids, ids, requests)
def test_an_instance_stays_on_its_wanted_id_once_its_deployments_name_it(
    held: set[int], named: set[int], requested: int | None
) -> None:
    wanted = wanted_id(held=held, named=named, uid="u", instance="", requested=requested)
    if wanted is not None:
        assert wanted_id(held=held, named={wanted}, uid="u", instance="", requested=requested) == wanted


@given(ids, st.lists(ids, max_size=3), ids, requests)
def test_nothing_is_created_while_something_acceptable_is_held(
    held: set[int], named: list[set[int]], free: set[int], requested: int | None
) -> None:
    plan = plan_domain(
        held=dict.fromkeys(held, False), named=named, free=free, uid="u", instance="", requested=requested
    )
    acceptable = {number for number in held if requested in {None, number}}
    assert (plan.step is Step.CREATE) == (not acceptable)
    if plan.step is Step.CREATE:
        assert set(plan.candidates) == (free if requested is None else {requested})
        assert len(set(plan.candidates)) == len(plan.candidates)
    if plan.step is Step.KEEP:
        assert all(names == {plan.id} for names in named)


def test_a_settled_instance_writes_nothing_and_a_draining_or_unnamed_claim_is_touched() -> None:
    def step(*, draining: bool = False, named: tuple[set[int], ...] = ({7},)) -> Step:
        return plan_domain(held={7: draining}, named=named, free={1}, uid="u", instance="", requested=None).step

    assert step() is Step.KEEP
    assert step(draining=True) is Step.ADOPT
    assert step(named=()) is Step.ADOPT
    assert step(named=({7}, set())) is Step.ADOPT
    assert step(named=({7}, {8})) is Step.ADOPT


def test_candidates_come_in_hash_order_but_a_lost_id_that_the_pods_use_comes_first() -> None:
    order = id_order({1, 2, 3}, "u", "")
    last = order[-1]
    fresh = plan_domain(held={}, named=[], free={1, 2, 3}, uid="u", instance="", requested=None)
    again = plan_domain(held={}, named=[{last}], free={1, 2, 3}, uid="u", instance="", requested=None)
    assert fresh.candidates == order
    assert again.candidates == (last, *order[:-1])


def test_only_claims_of_this_pool_scope_and_instance_are_held() -> None:
    claims = [
        domain_claim(1),
        domain_claim(2, pool="other"),
        domain_claim(3, app_holder("app-2")),
        domain_claim(4, app_holder(instance="amr-1")),
    ]
    assert set(domain.held_ids(claims, ASK, "Cluster")) == {1}
    assert set(domain.held_ids(claims, ASK, "Node")) == set()


def test_shared_and_reserved_ids_and_those_held_in_other_pools_are_no_candidates() -> None:
    found = domain.free_ids(pool("1-9", shared_ids="8-9", reserved=(1,)), [domain_claim(3, pool="other")], ASK)
    assert found == {2, 4, 5, 6, 7}


def test_fences_carry_uid_and_version_of_every_deployment() -> None:
    assert domain.fences_of([deployment(7, version="41")]) == {
        "teleop-driver": Fence(uid="uid-teleop-driver", resource_version="41")
    }


@pytest.mark.parametrize(
    ("named", "held", "unheld"),
    [((7,), {7}, ()), ((7,), {8}, ("teleop-driver",)), ((), {8}, ()), ((7,), set(), ("teleop-driver",))],
)
def test_deployments_that_name_an_id_not_held_are_listed(
    named: tuple[int, ...], held: set[int], unheld: tuple[str, ...]
) -> None:
    assert domain.naming_unheld([deployment(*named)], held) == unheld


def test_a_pool_per_zone_needs_a_place() -> None:
    refusal = domain.check_request(ASK, pool(scope="Zone"))
    assert refusal is not None
    assert refusal.reason == Reason.INVALID_SPEC
    assert "spec.placement.zones" in refusal.message
    assert domain.check_request(DomainRequest(app_holder(), scope_value="z1"), pool(scope="Zone")) is None


def asking(number: int | None, *, pod: bool = False, allow_unsafe: bool = False) -> DomainRequest:
    holder = holder_of_pod(namespace="a", name="talker", uid="u") if pod else app_holder()
    return DomainRequest(holder, requested_id=number, allow_unsafe=allow_unsafe)


@pytest.mark.parametrize("allow_unsafe", [False, True])
@pytest.mark.parametrize("number", [0, 3, 150])
def test_a_reserved_id_goes_to_nobody_however_it_is_asked_for(number: int, allow_unsafe: bool) -> None:
    refusal = domain.withheld(asking(number, allow_unsafe=allow_unsafe), pool("1-5,150", reserved=(0, 3, 150)))
    assert refusal is not None
    assert refusal.reason == Reason.INVALID_SPEC
    assert "reserved in pool default" in refusal.message
    assert "leave spec.ros2.domain out" in refusal.message


@pytest.mark.parametrize("number", [0, 102, 214])
def test_an_unsafe_id_needs_leave_in_the_spec_or_a_pool_that_hands_it_out(number: int) -> None:
    refusal = domain.withheld(asking(number), pool("1-101"))
    assert refusal is not None
    assert "allowUnsafeDomain" in refusal.message
    assert domain.withheld(asking(number, allow_unsafe=True), pool("1-101")) is None
    assert domain.withheld(asking(number), pool(f"{number}")) is None


def test_a_bare_pod_cannot_get_an_unsafe_id_and_is_told_about_its_annotation() -> None:
    for number in (0, 3):
        refusal = domain.withheld(asking(number, pod=True), pool("1-5", reserved=(3,)))
        assert refusal is not None
        assert "annotation scheduler.robotics.io/dds-domain" in refusal.message
        assert "spec.ros2" not in refusal.message


def test_a_bare_pod_is_told_of_no_field_of_a_robotapp() -> None:
    request, full = asking(3, pod=True), pool("1-3")
    told = [
        domain.taken(request, app_holder()),
        domain.exhausted(request, full, claimed=3, resting=0),
        domain.pool_not_found(request),
        domain.over_quota(request, pool("1-3", quota=PoolQuota(default=0)), held=0),
    ]
    assert not [each for each in told if each is None or "spec.ros2" in each.message]


def test_safe_numbers_and_no_number_are_not_withheld() -> None:
    for number in (None, 1, 60, 101, 215, 232):
        assert domain.withheld(asking(number), pool("1-5", reserved=(0,))) is None


def test_isolation_discovery_takes_no_reserved_id_but_stays_on_one_in_use() -> None:
    shared = pool("1-3", shared_ids="90-91", reserved=(90,))
    fresh = domain.shared_id(shared, uses={91: 9}, named=(), uid="u", instance="")
    assert fresh.id == 91
    assert domain.shared_id(shared, uses={}, named={90}, uid="u", instance="").id == 90
    nothing = domain.shared_id(pool("1-3", shared_ids="90", reserved=(90,)), uses={}, named=(), uid="u", instance="")
    assert (nothing.id, nothing.reason) == (None, Reason.DOMAIN_EXHAUSTED)


def test_a_shared_id_cannot_be_claimed_by_asking_for_it() -> None:
    refusal = domain.check_request(DomainRequest(app_holder(), requested_id=9), pool("1-3", shared_ids="8-9"))
    assert refusal is not None
    assert refusal.reason == Reason.DOMAIN_TAKEN
    assert "isolation: Discovery" in refusal.message


def test_exhaustion_says_how_many_are_claimed_how_many_rest_and_what_to_do() -> None:
    outcome = domain.exhausted(ASK, pool("1-101,215-232"), claimed=119, resting=4)
    assert outcome.reason == Reason.DOMAIN_EXHAUSTED
    assert not outcome.held
    assert "119 of 119" in outcome.message
    assert "4 of them resting up to 60 s" in outcome.message
    assert "add ids to DomainPool default" in outcome.message


def test_the_holder_of_a_taken_id_is_named_within_the_namespace_only() -> None:
    ask = DomainRequest(app_holder("app-2", name="b"), requested_id=7)
    assert "team/teleop" in domain.taken(ask, app_holder()).message
    stranger = app_holder()
    other = type(stranger)(**{f: getattr(stranger, f) for f in stranger.__struct_fields__} | {"namespace": "x"})
    assert "another namespace" in domain.taken(ask, other).message


@pytest.mark.parametrize(
    ("quota", "held", "over"),
    [
        (PoolQuota(), 200, False),
        (PoolQuota(default=2), 1, False),
        (PoolQuota(default=2), 2, True),
        (PoolQuota(default=2, namespaces={"team": 5}), 4, False),
        (PoolQuota(namespaces={"team": 5}), 4, False),
        (PoolQuota(namespaces={"team": 5}), 5, True),
        (PoolQuota(namespaces={"other": 0}), 200, False),
        (PoolQuota(default=0, namespaces={"team": 5}), 4, False),
        (PoolQuota(default=0, namespaces={"team": 5}), 5, True),
    ],
)
def test_the_quota_of_a_namespace_is_its_own_or_the_default_and_unlimited_when_both_are_absent(
    quota: PoolQuota, held: int, over: bool
) -> None:
    refusal = domain.over_quota(ASK, pool(quota=quota), held=held)
    assert (refusal is not None) is over
    if refusal is not None:
        assert refusal.reason == Reason.QUOTA_EXCEEDED
        assert f"holds {held} of the" in refusal.message
        assert "delete an app there, or ask for a higher quota in DomainPool default" in refusal.message


@pytest.mark.parametrize(
    ("quota", "field"),
    [
        (PoolQuota(default=0), "spec.quota.default"),
        (PoolQuota(default=0, namespaces={"other": 3}), "spec.quota.default"),
        (PoolQuota(namespaces={"team": 0}), "spec.quota.namespaces.team"),
        (PoolQuota(default=2, namespaces={"team": 0}), "spec.quota.namespaces.team"),
    ],
)
@pytest.mark.parametrize("held", [0, 3])
def test_a_quota_of_zero_is_no_domain_at_all_and_the_message_names_the_field_and_the_cure(
    quota: PoolQuota, field: str, held: int
) -> None:
    refusal = domain.over_quota(ASK, pool(quota=quota), held=held)
    assert refusal is not None
    assert refusal.reason == Reason.QUOTA_EXCEEDED
    assert f"gives namespace team 0 domain ids ({field})" in refusal.message
    assert "use another pool (spec.ros2.pool), or ask for a quota above 0 in DomainPool default" in refusal.message


@pytest.mark.parametrize(
    ("json", "quota"),
    [
        ("{}", PoolQuota(default=None)),
        ('{"default": 0}', PoolQuota(default=0)),
        ('{"namespaces": {"team": 0}}', PoolQuota(namespaces={"team": 0})),
    ],
)
def test_an_absent_quota_is_not_a_quota_of_zero_on_the_wire(json: str, quota: PoolQuota) -> None:
    assert msgspec.json.decode(json, type=PoolQuota) == quota


def test_isolation_discovery_stays_where_it_is_and_else_takes_the_least_used_shared_id() -> None:
    shared = pool("1-3", shared_ids="90-92")
    new = domain.shared_id(shared, uses={90: 3, 91: 1, 92: 2}, named=(), uid="u", instance="")
    stay = domain.shared_id(shared, uses={90: 3, 91: 1, 92: 2}, named=(90,), uid="u", instance="")
    none = domain.shared_id(pool(), uses={}, named=(), uid="u", instance="")
    assert (new.id, stay.id, none.id) == (91, 90, None)
    assert new.claim == ""
    assert "sharedIds" in none.message


def test_a_bare_pod_that_waits_for_a_full_pool_is_told_the_same_whatever_rests_just_now() -> None:
    pod = DomainRequest(holder_of_pod(namespace="team", name="talker", uid="p"))
    told = {domain.exhausted(pod, pool("1-3"), claimed=3, resting=n, parked=n).message for n in range(3)}
    assert len(told) == 1
    assert "3 of 3 domain ids" in told.pop()
