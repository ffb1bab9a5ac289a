"""The lock of the node's devices."""

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.support.agent.dra import BOOT, NODE, device, prepared

from robotapp_agent.driver.rules.ledger import Held, Ledger, PreparedClaim


def test_a_device_of_one_claim_is_refused_to_another() -> None:
    ledger = Ledger().prepare(prepared("first"))
    assert isinstance(ledger, Ledger)
    held = ledger.prepare(prepared("second"))
    assert isinstance(held, Held)
    assert held.explain(node=NODE, namespace="fleet") == (
        f"device {device().id} of node robot-1 is in use by claim first; the pod starts when it is free"
    )


def numbered(name: str, device_id: str, *numbers: int, boot_id: str = BOOT) -> PreparedClaim:
    claim = prepared(name, device_id, boot_id=boot_id)
    return replace(claim, devices=tuple(replace(device, numbers=numbers) for device in claim.devices))


def test_a_device_with_the_file_of_one_that_a_container_lost_is_refused_until_that_has_ended() -> None:
    """The container's rules still let it open this number, and drivers try the path again and again."""
    ledger = Ledger().prepare(numbered("first", "serial-lost", 7, 8))
    assert isinstance(ledger, Ledger)
    held = ledger.prepare(numbered("second", "serial-new", 8))
    assert isinstance(held, Held)
    assert held.explain(node=NODE, namespace="fleet") == (
        "device serial-new of node robot-1 is in use by claim first for serial-lost, which was unplugged and had the same device file; "
        "the pod starts when it is free"
    )
    assert isinstance(ledger.prepare(numbered("second", "serial-new", 9)), Ledger)
    assert isinstance(ledger.release("uid-of-first").prepare(numbered("second", "serial-new", 8)), Ledger)
    assert isinstance(ledger.prepare(numbered("second", "serial-new", 8, boot_id="boot-2")), Ledger)


def test_names_of_other_namespaces_are_not_told() -> None:
    held = Held("can-can0", prepared("secret-plan", namespace="rival"))
    assert "secret-plan" not in held.explain(node=NODE, namespace="fleet")
    assert "rival" not in held.explain(node=NODE, namespace="fleet")


def test_preparing_again_changes_nothing() -> None:
    ledger = Ledger().prepare(prepared())
    assert isinstance(ledger, Ledger)
    assert ledger.prepare(prepared()) == ledger


def test_admin_access_neither_takes_nor_respects_the_lock() -> None:
    one = prepared("admin")
    admin = PreparedClaim(
        uid=one.uid,
        namespace=one.namespace,
        name=one.name,
        boot_id=one.boot_id,
        devices=tuple(type(d)(d.request, d.pool, d.device, d.variable, admin=True) for d in one.devices),
    )
    ledger = Ledger().prepare(admin)
    assert isinstance(ledger, Ledger)
    both = ledger.prepare(prepared("driver"))
    assert isinstance(both, Ledger)
    assert both.prepare(admin) == both


def test_a_device_stays_locked_between_two_pods_of_its_claim() -> None:
    ledger = Ledger().prepare(prepared("first"))
    assert isinstance(ledger, Ledger)
    between = ledger.release("uid-of-first")
    assert not between.claims["uid-of-first"].is_prepared("boot-1")
    assert isinstance(between.prepare(prepared("second")), Held)
    assert between.prepare(prepared("first")) == ledger
    assert between.forget_unallocated("uid-of-first", allocated=[device().id], boot_id="boot-1") is between
    given_up = between.forget_unallocated("uid-of-first", allocated=[], boot_id="boot-1")
    assert given_up.claims == {}
    assert ledger.forget_unallocated("uid-of-first", allocated=[], boot_id="boot-1") is ledger, (
        "a container may have it"
    )
    assert isinstance(between.forget("uid-of-first", allocated=["serial-9"]).prepare(prepared("second")), Ledger)


def test_a_claim_of_an_earlier_boot_is_not_prepared() -> None:
    assert prepared("old", boot_id="boot-0").is_prepared("boot-0")
    assert not prepared("old", boot_id="boot-0").is_prepared("boot-1")


def test_a_device_that_a_container_may_have_is_not_exchanged_below_it() -> None:
    ledger = Ledger().prepare(prepared("driver", "x", "y"))
    assert isinstance(ledger, Ledger)
    assert ledger.find_former_device(prepared("driver", "y", "z")) == "x"
    assert ledger.find_former_device(prepared("driver", "x", "y", "z")) == ""
    assert ledger.find_former_device(prepared("driver", "z", boot_id="boot-2")) == ""
    assert ledger.release("uid-of-driver").find_former_device(prepared("driver", "z")) == ""


steps = st.lists(
    st.one_of(
        st.tuples(st.just("prepare"), st.sampled_from("abcd"), st.sets(st.sampled_from(["x", "y", "z"]), min_size=1)),
        st.tuples(st.just("release"), st.sampled_from("abcd"), st.just(set[str]())),
        st.tuples(st.just("forget"), st.sampled_from("abcd"), st.sets(st.sampled_from(["x", "y", "z"]))),
    ),
    max_size=20,
)


@given(steps)
def test_no_order_of_steps_gives_a_device_to_two_claims(steps: list[tuple[str, str, set[str]]]) -> None:
    ledger = Ledger()
    for step, name, ids in steps:
        if step == "release":
            ledger = ledger.release(f"uid-of-{name}")
            continue
        if step == "forget":
            if f"uid-of-{name}" in ledger.claims:
                ledger = ledger.forget(f"uid-of-{name}", allocated=ids)
            continue
        taken = {d.device for claim in ledger.claims.values() if claim.name != name for d in claim.devices}
        after = ledger.prepare(prepared(name, *sorted(ids)))
        assert isinstance(after, Held) is bool(taken & ids)
        ledger = ledger if isinstance(after, Held) else after
        devices = [d.device for claim in ledger.claims.values() for d in claim.devices]
        assert len(devices) == len(set(devices))
