import pytest

from robotapp_agent.probe.keys import KEPT_S, MOST_KEYS, SETTLED_S, KeyRing, key_of

OLD, NEW, THIRD = (letter * 32 for letter in (b"o", b"n", b"t"))


def ring_at(*steps: tuple[float, dict[str, bytes]]) -> KeyRing:
    ring = KeyRing()
    for now_s, files in steps:
        ring.update(files, now_s=now_s)
    return ring


def test_an_empty_ring_signs_nothing() -> None:
    assert KeyRing().signing is None


def test_a_single_key_signs_at_once() -> None:
    assert ring_at((0, {"1": OLD})).signing == key_of(OLD)


def test_a_new_key_verifies_at_once_and_signs_when_all_nodes_have_had_the_time_to_get_it() -> None:
    ring = ring_at((0, {"1": OLD}), (1000, {"1": OLD, "2": NEW}))
    assert ring.find(key_of(NEW).id) == key_of(NEW)
    assert ring.signing == key_of(OLD)
    ring.update({"1": OLD, "2": NEW}, now_s=1000 + SETTLED_S - 1)
    assert ring.signing == key_of(OLD)
    ring.update({"1": OLD, "2": NEW}, now_s=1000 + SETTLED_S)
    assert ring.signing == key_of(NEW)


def test_an_agent_that_has_just_started_signs_with_the_oldest() -> None:
    assert ring_at((0, {"2": NEW, "1": OLD})).signing == key_of(OLD)


def test_current_is_the_newest_whatever_the_others_are_called() -> None:
    files = {"current": NEW, "previous": OLD, "zzz": THIRD}
    assert ring_at((0, files)).signing == key_of(OLD)
    assert ring_at((0, files), (SETTLED_S, files)).signing == key_of(NEW)


def test_a_removed_key_verifies_for_a_while_and_is_forgotten_then() -> None:
    ring = ring_at((0, {"1": OLD, "2": NEW}), (1000, {"2": NEW}))
    assert ring.signing == key_of(NEW)
    assert ring.find(key_of(OLD).id)
    ring.update({"2": NEW}, now_s=1000 + KEPT_S - 1)
    assert ring.find(key_of(OLD).id)
    ring.update({"2": NEW}, now_s=1000 + KEPT_S)
    assert ring.find(key_of(OLD).id) is None


def test_a_key_that_replaced_the_only_one_in_one_step_signs_when_it_has_settled() -> None:
    ring = ring_at((0, {"1": OLD}), (1000, {"1": NEW}))
    assert ring.signing == key_of(OLD)
    ring.update({"1": NEW}, now_s=1000 + SETTLED_S)
    assert ring.signing == key_of(NEW)


def test_a_key_that_comes_back_has_been_here_all_the_time() -> None:
    ring = ring_at((0, {"1": OLD, "2": NEW}), (1000, {"1": OLD}), (1001, {"1": OLD, "2": NEW}))
    assert ring.signing == key_of(NEW)


@pytest.mark.parametrize("replaced_in_one_step", [False, True])
@pytest.mark.parametrize("first", ["a", "b"])
def test_rotation_loses_no_probe_while_two_nodes_see_it_up_to_five_minutes_apart(
    *, replaced_in_one_step: bool, first: str
) -> None:
    """Second by second: whatever one signs the other can verify."""
    rings = {"a": KeyRing(), "b": KeyRing()}
    for now_s in range(0, 4000, 5):
        for name, ring in rings.items():
            seen_s = now_s if name == first else now_s - 299
            ring.update(_secret_at(seen_s, replaced_in_one_step=replaced_in_one_step), now_s=now_s)
        for one, other in (("a", "b"), ("b", "a")):
            signing = rings[one].signing
            assert signing
            assert rings[other].find(signing.id), f"{one} signs what {other} does not know after {now_s} s"
    assert rings["a"].signing == rings["b"].signing == key_of(NEW)


def _secret_at(now_s: float, *, replaced_in_one_step: bool) -> dict[str, bytes]:
    if now_s < 1000:
        return {"1": OLD}
    return {"1": OLD, "2": NEW} if now_s < 1600 and not replaced_in_one_step else {"2": NEW}


@pytest.mark.parametrize("secret", [b"", b"short", bytes(2000)])
def test_a_key_of_a_wrong_length_is_left_out_and_named(secret: bytes) -> None:
    ring = KeyRing()
    (problem,) = ring.update({"1": OLD, "bad": secret}, now_s=0)
    assert problem.startswith(f"probe key bad has {len(secret)} bytes, allowed are 16 to 1024")
    assert ring.signing == key_of(OLD)


def test_of_too_many_keys_the_newest_are_used() -> None:
    ring = KeyRing()
    files = {f"{index:02}": bytes([index]) * 32 for index in range(MOST_KEYS + 2)}
    (problem,) = ring.update(files, now_s=0)
    assert problem == "there are 10 probe keys, at most 8 are used: remove the oldest (00, 01)"
    assert [ring.find(key_of(secret).id) is None for secret in files.values()] == [True, True] + [False] * MOST_KEYS


def test_the_ring_stays_small_however_often_the_secret_changes() -> None:
    ring = KeyRing()
    for index in range(500):
        ring.update({str(index): index.to_bytes(32, "big")}, now_s=index)
    assert len(ring._held) <= 2 * MOST_KEYS


def test_the_id_of_a_key_does_not_give_it_away() -> None:
    key = key_of(OLD)
    assert len(key.id) == 8
    assert key.id not in OLD
    assert key.id != key_of(NEW).id
