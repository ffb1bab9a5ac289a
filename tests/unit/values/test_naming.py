"""Derived names."""

import re

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.naming import child_name, short_hash

LABELS = st.from_regex(r"[a-z0-9]([-a-z0-9]{0,60}[a-z0-9])?", fullmatch=True)
ROBOTS = st.one_of(st.just(""), st.text(max_size=63))


@given(LABELS, ROBOTS, st.one_of(st.just(""), LABELS))
def test_a_child_name_is_a_label_that_services_accept(app: str, robot: str, component: str) -> None:
    name = child_name(app, robot, component)
    assert len(name) <= 63
    assert re.fullmatch(r"[a-z]([-a-z0-9]*[a-z0-9])?", name)


@given(st.lists(st.tuples(LABELS, ROBOTS.filter(lambda r: "/" not in r), LABELS), min_size=2, max_size=2, unique=True))
def test_different_children_have_different_names(pair: list[tuple[str, str, str]]) -> None:
    assert child_name(*pair[0]) != child_name(*pair[1])


def test_names_are_readable_and_never_change_between_releases() -> None:
    assert child_name("teleop", "amr-07", "driver") == f"teleop-amr-07-driver-{short_hash('teleop/amr-07/driver', 8)}"
    assert child_name("teleop", "", "driver") == "teleop-driver-" + short_hash("teleop//driver", 8)
    assert short_hash("amr-07", 10) == "714a2911f0"
