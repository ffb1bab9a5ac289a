import itertools
from functools import reduce
from operator import or_

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.queue import in_flight
from robotapp_scheduler.core.queue.in_flight import InFlightPod, InFlightPods


def changes(flight: InFlightPod) -> Change:
    return reduce(or_, (event.change for event in flight.seen), Change.NONE)


def test_a_pod_lands_with_what_changed_while_it_was_away_and_nothing_else() -> None:
    found = InFlightPods()
    found.start("a", "A")
    found.note(Event("", Change.LABELS), but="")
    found.start("b", "B")
    found.note(Event("", Change.CLAIMS), but="")
    one, other = found.land("a"), found.land("b")
    assert one is not None
    assert other is not None
    assert (one.pod, changes(one)) == ("A", Change.LABELS | Change.CLAIMS)
    assert changes(other) == Change.CLAIMS
    assert list(found) == []


def test_a_pod_takes_no_notice_of_the_room_its_own_failure_freed() -> None:
    found = InFlightPods()
    found.start("a", "A")
    found.note(Event("", Change.POD_REMOVED), but="a")
    landed = found.land("a")
    assert landed is not None
    assert landed.seen == []


def test_nobody_in_flight_nothing_is_kept() -> None:
    found = InFlightPods()
    found.note(Event("", Change.LABELS), but="")
    found.start("a", "A")
    landed = found.land("a")
    assert landed is not None
    assert landed.seen == []
    assert found.land("a") is None


def test_short_flights_keep_the_objects_of_what_they_saw(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(in_flight, "MOST_LOGGED", 4)
    found = InFlightPods()
    uids = [f"u{i}" for i in range(20)]
    found.start(uids[0], "")
    for before, uid in itertools.pairwise(uids):
        found.note(Event("nodes", Change.TAINTS, before, uid), but="")
        found.start(uid, "")
        landed = found.land(before)
        assert landed is not None
        assert [(event.old, event.new) for event in landed.seen] == [(before, uid)]


steps = st.lists(
    st.tuples(
        st.sampled_from(["start", "end", "land", "note"]), st.sampled_from("abc"), st.sampled_from(list(Change)[1:6])
    ),
    max_size=60,
)


@given(steps, st.integers(1, 5))
def test_the_log_tells_the_same_as_telling_every_pod_at_once(script: list[tuple[str, str, Change]], limit: int) -> None:
    before, in_flight.MOST_LOGGED = in_flight.MOST_LOGGED, limit
    try:
        found, expected = InFlightPods(), dict[str, int]()
        for step, uid, change in script:
            if step == "start" and uid not in found:
                found.start(uid, uid)
                expected[uid] = 0
            elif step == "note":
                found.note(Event("", change), but=uid)
                expected = {key: seen if key == uid else seen | change for key, seen in expected.items()}
                assert len(found._log) <= limit
            elif step == "end":
                found.end(uid)
                expected.pop(uid, None)
            elif step == "land" and uid in found:
                landed = found.land(uid)
                assert landed is not None
                assert int(changes(landed)) == expected.pop(uid)
        assert set(found) == set(expected)
    finally:
        in_flight.MOST_LOGGED = before
