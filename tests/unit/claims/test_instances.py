import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.claims.instances import chosen_instance, robot_selector, selector_text
from robotapp_api.claims.objects import LabelExpression, LabelSelector


@pytest.mark.parametrize(
    ("selector", "text"),
    [
        (LabelSelector(), ""),
        (LabelSelector(match_labels={"b": "2", "a": "1"}), "a=1,b=2"),
        (
            LabelSelector(
                match_expressions=(
                    LabelExpression(key="k", operator="In", values=("x", "y")),
                    LabelExpression(key="k", operator="NotIn", values=("z",)),
                    LabelExpression(key="e", operator="Exists"),
                    LabelExpression(key="d", operator="DoesNotExist"),
                )
            ),
            "k in (x,y),k notin (z),e,!d",
        ),
    ],
)
def test_a_selector_becomes_the_query_the_api_server_evaluates(selector: LabelSelector, text: str) -> None:
    assert selector_text(selector) == text
    assert robot_selector(selector, "amr-07") == ",".join(p for p in ("robotics.io/robot=amr-07", text) if p)


robots = st.sets(st.sampled_from(["amr-1", "amr-2", "amr-3"]))


@given(robots, robots)
def test_an_app_for_any_robot_stays_where_it_runs(claimed: set[str], deployed: set[str]) -> None:
    chosen = chosen_instance("u", claimed=claimed, deployed=deployed)
    assert (chosen in deployed) if deployed else (chosen in claimed or (not claimed and chosen is None))
