"""Laws of `run` and `launch`, whatever the robot is called and whatever stands in their fields."""

import re

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app

from robotapp_api.model.app.program import NODE_NAME_PATTERN
from robotapp_api.model.patterns import LABEL_VALUE_PATTERN
from robotapp_api.values.references import expand, to_ros_name
from robotapp_operator.plan.render.command_line import render_arguments
from robotapp_operator.plan.render.parameters import NONE
from robotapp_operator.plan.spec.desired import desired_of

ROBOTS = st.from_regex(LABEL_VALUE_PATTERN, fullmatch=True).filter(lambda name: 0 < len(name) <= 63)
WORDS = st.text(alphabet="ab-$() _=", max_size=8)
TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@given(ROBOTS)
def test_every_robot_has_a_ros_name(robot: str) -> None:
    assert TOKEN.fullmatch(to_ros_name(robot))


@given(WORDS, ROBOTS)
def test_references_are_replaced_as_the_kubelet_would_and_nothing_else_is(text: str, robot: str) -> None:
    values = {"ROBOTAPP_ROBOT": robot}
    assert expand(text, values) == text, "there is no reference to replace"
    assert expand(f"{text}|$(ROBOTAPP_ROBOT)", values) == f"{text}|{robot}"
    assert expand(f"{text}|$$(ROBOTAPP_ROBOT)", values) == f"{text}|$$(ROBOTAPP_ROBOT)"
    assert expand(f"{text}|$(HOME)", values) == f"{text}|$(HOME)"


@given(
    robot=ROBOTS,
    distro=st.sampled_from(["jazzy", "noetic"]),
    name=st.from_regex(NODE_NAME_PATTERN, fullmatch=True).filter(lambda name: len(name) <= 64),
    args=st.lists(WORDS, max_size=3),
)
def test_each_argument_stays_one_word_in_its_order_and_names_are_ros_names(
    robot: str, distro: str, name: str, args: list[str]
) -> None:
    run = {"package": "p", "executable": "e", "name": name, "namespace": f"/{name}", "args": args}
    app = make_app(component("driver", run=run, replicaIdentity="Ordinal"), ros={"distro": distro})
    words = render_arguments(app.spec.components[0], desired_of(app, robot), NONE)
    tool = ["ros2", "run"] if distro == "jazzy" else ["rosrun"]
    start = len(tool) + 2
    assert words[:start] == [*tool, "p", "e"]
    assert words[start : start + len(args)] == args
    rules = [word for word in words[start + len(args) :] if ":=" in word]
    assert [rule.partition(":=")[0] for rule in rules] == ["__node" if distro == "jazzy" else "__name", "__ns"]
    assert all(TOKEN.fullmatch(rule.partition(":=")[2].lstrip("/")) for rule in rules)
