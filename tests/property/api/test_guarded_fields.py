"""The search for guarded fields: no shape of a borrowed field ends it, and what it finds depends on the values alone."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.live.attacks.table.host_access import BAD, honest_app, places_of, written

from robotapp_api.checks.host_access.guarded import find_guarded, find_rights, host_access_problems
from robotapp_api.checks.host_access.table import GUARDED
from robotapp_api.checks.spec import spec_problems
from robotapp_api.model.app.robotapp import RobotAppSpec

NAMES = sorted({step.removesuffix("[]") for field in GUARDED for step in field.path.split(".")})
ANY = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-1, 70_000), st.sampled_from(("", "Unconfined", "KILL"))),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(NAMES), inner, max_size=4)),
    max_leaves=12,
)
OBJECT = st.dictionaries(st.sampled_from(NAMES), ANY, max_size=5)
CHOICES = st.lists(
    st.tuples(st.sampled_from(GUARDED), st.integers(0, 6), st.booleans()),
    max_size=5,
    unique_by=lambda each: each[0].path,
)


@given(OBJECT, OBJECT, OBJECT)
def test_no_shape_of_a_borrowed_field_ends_a_check(own: dict[str, Any], further: dict[str, Any], pod: Any) -> None:
    """The API server checks shapes; a check that failed on one it lets through would stop the work on the app."""
    spec = RobotAppSpec.model_validate(
        {
            "ros": {"distro": "jazzy"},
            "components": [
                {
                    "name": "a",
                    "image": "x",
                    "securityContext": own,
                    "lifecycle": own,
                    "template": {
                        "spec": {"containers": [further], "initContainers": [further], "securityContext": pod}
                    },
                }
            ],
        }
    )
    assert len(list(find_guarded(spec))) >= len(find_rights(spec)) == len(list(host_access_problems(spec)))


@given(CHOICES)
def test_exactly_the_bad_values_are_found(choices: list[tuple[Any, int, bool]]) -> None:
    """Each field is written into one place of an app of its own; order and number of apps do not count."""
    for field, number, bad in choices:
        places = list(places_of(field).values())
        free = ("runtime/default",) if field.level.value == "annotations" else field.free
        value = BAD[field.path] if bad or not free else free[number % len(free)]
        spec = RobotAppSpec.model_validate(written(field, places[number % len(places)], value)["spec"])
        assert {use.field.path for use in find_guarded(spec)} == ({field.path} if bad or not free else set())


def test_an_app_with_every_kind_of_container_is_understood() -> None:
    spec = RobotAppSpec.model_validate(honest_app()["spec"] | {"ros1": None})
    assert not [problem for problem in spec_problems(spec) if "containers" in problem.field.lower()]
