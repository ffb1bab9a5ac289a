"""Texts that are expanded for each robot: a look at the decisive robots finds what a look at all of them would."""

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.patterns import LABEL_VALUE_PATTERN
from robotapp_api.values.component_references import ExpandedText, expanded_problem
from robotapp_api.values.references import reference_values
from robotapp_operator.plan.spec.validate import decisive_robots

ROBOTS = st.lists(
    st.one_of(
        st.from_regex(LABEL_VALUE_PATTERN, fullmatch=True),
        st.text(alphabet="aA0-_.", min_size=1, max_size=63).filter(
            lambda name: name[0] + name[-1] in ("aa", "AA", "0a")
        ),
    ).filter(lambda name: 0 < len(name) <= 63),
    max_size=5,
)
TEXTS = st.builds(
    lambda parts, end: "".join(f"{part}$(ROBOTAPP_ROBOT)" for part in parts) + end,
    st.lists(st.sampled_from(["", "a", "a-", "a.", "-", ".", "a" * 60]), min_size=1, max_size=4),
    st.sampled_from(["", "a", "-a", ".yaml", "b" * 60]),
)


@given(st.sampled_from(["name", "key", "label"]), TEXTS, ROBOTS)
def test_if_a_text_is_wrong_for_any_robot_it_is_for_a_decisive_one(kind: str, text: str, robots: list[str]) -> None:
    expanded = ExpandedText("", kind, text)
    if expanded_problem(expanded, reference_values("r")):
        return  # refused whatever robots there are
    decisive = decisive_robots(kind, sorted(robots))
    assert any(expanded_problem(expanded, reference_values(robot)) for robot in robots) == any(
        expanded_problem(expanded, reference_values(robot)) for robot in decisive
    )
    assert len(decisive) <= 2
