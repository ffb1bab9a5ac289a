"""Texts that Rigel writes into a Dockerfile mean in a RobotApp what they mean in the image."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.rigel.rigelfiles import ONE, refusal, rendered, spec

from rigel_bridge.generations.dockerfile import (
    DockerError,
    FromBase,
    escape_for_kubernetes,
    expand_word,
    read_command,
    read_env,
)

JOBS = """\
application: {distro: kilted}
jobs:
  dockerfile:
    plugin: rigel.plugins.core.DockerfilePlugin
    with:
      ros_image: ros:kilted-ros-base
      command: ros2 launch draw bringup.launch.py
      compiler: {name: colcon}
      env:
        - {name: RCUTILS_CONSOLE_OUTPUT_FORMAT, value: '"[{severity} {time}] [{name}]: {message}"'}
        - {name: GAZEBO_MODEL_PATH, value: "$GAZEBO_MODEL_PATH:/home/me/models"}
        - {name: TOOL, value: /opt/tool}
        - {name: PATH, value: "/opt/tool/bin:$PATH"}
        - {name: LIBRARY, value: "${TOOL}/lib"}
"""
BUILD = "  build: {plugin: rigel.plugins.core.BuildXPlugin, with: {image: acme/draw, tags: [v1], push: true}}\n"
DEPLOY = "  deploy: {plugin: rigel_bridge.RobotAppPlugin, with: {orchestration: {}}}\n"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ('"[{name}]: {message}"', "[{name}]: {message}"),
        ("'a  b'", "a  b"),
        ("a  b", "a  b"),
        (r"a\ b", "a b"),
        (r'"say \"hi\" \n"', r'say "hi" \n'),
        (r"'$A \n'", r"$A \n"),
        (r"\$A", "$A"),
        ("$A/${A}", "1/1"),
        ("$(A)", "$(A)"),
        ("a'b'\"c\"", "abc"),
        ("a \\\n  b", "a   b"),
        ("a\\", "a"),
        ("", ""),
        ("{x: 1}", "{x: 1}"),
    ],
)
def test_a_value_loses_what_docker_takes_from_it(text: str, value: str) -> None:
    assert expand_word(text, {"A": "1"}) == value


@pytest.mark.parametrize("text", ["$PATH", "a:${PATH}", "${A:-b}", '"$PATH"', "${PATH#x}"])
def test_what_only_a_build_works_out_is_none_of_the_pods_variables(text: str) -> None:
    with pytest.raises(FromBase):
        expand_word(text, {"A": "1"})


@pytest.mark.parametrize("text", ['"a', "'a", "a\nb"])
def test_what_docker_refuses_is_refused(text: str) -> None:
    with pytest.raises(DockerError):
        expand_word(text, {})


@given(st.text(st.characters(blacklist_categories=["Cs", "Cc"]), max_size=40))
def test_any_text_in_docker_quotes_is_that_text(text: str) -> None:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("$", "\\$")
    assert expand_word(f'"{escaped}"', {}) == text


def test_a_later_variable_sees_the_earlier_ones_and_none_that_only_the_base_states() -> None:
    found = read_env({"A": "1", "B": "$A$A", "C": "$PATH", "D": "$C"})
    assert found.values == {"A": "1", "B": "11"}
    assert found.from_base == {"C": "$PATH", "D": "$C"}


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("$(date)", "$$(date)"),
        ("$$", "$$$"),
        ("$HOME", "$HOME"),
        ("$(ROBOTAPP_DEVICE_LIDAR)", "$(ROBOTAPP_DEVICE_LIDAR)"),
        ("$(ROS_DOMAIN_ID)", "$(ROS_DOMAIN_ID)"),
    ],
)
def test_kubernetes_replaces_nothing_that_docker_left(text: str, kept: str) -> None:
    assert escape_for_kubernetes(text) == kept


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ros2 run a b", ["ros2", "run", "a", "b"]),
        ('["ros2", "run", "a b"]', ["ros2", "run", "a b"]),
        ("ros2 run a b --ros-args -p 'x:=a b'", ["ros2", "run", "a", "b", "--ros-args", "-p", "x:=a b"]),
        ("ros2 launch a b.py map:=$HOME/map", ["/bin/sh", "-c", "ros2 launch a b.py map:=$HOME/map"]),
        ("cd /ws && ./run", ["/bin/sh", "-c", "cd /ws && ./run"]),
        ("source x", ["/bin/sh", "-c", "source x"]),
        ("SPEED=1 ros2 run a b", ["/bin/sh", "-c", "SPEED=1 ros2 run a b"]),
        ("echo '$HOME && x'", ["echo", "$HOME && x"]),
        ('echo "$HOME"', ["/bin/sh", "-c", 'echo "$HOME"']),
        (r"echo \$HOME", ["echo", "$HOME"]),
        ("drive $(ROBOTAPP_DEVICE_LIDAR)", ["drive", "$(ROBOTAPP_DEVICE_LIDAR)"]),
    ],
)
def test_a_command_has_the_words_that_the_container_gets(text: str, words: list[str]) -> None:
    assert read_command(text) == words


def test_variables_of_a_container_file_are_those_of_the_image() -> None:
    made = rendered(JOBS + BUILD + DEPLOY)
    (component,) = made.app["spec"]["components"]
    assert {entry["name"]: entry["value"] for entry in component["env"]} == {
        "RCUTILS_CONSOLE_OUTPUT_FORMAT": "[{severity} {time}] [{name}]: {message}",
        "TOOL": "/opt/tool",
        "LIBRARY": "/opt/tool/lib",
    }
    assert [note.partition(": ")[2][:20] for note in made.notes[:2]] == ["env GAZEBO_MODEL_PAT", "env PATH refers to $"]


def test_a_domain_that_only_the_image_states_is_refused() -> None:
    text = ONE + "    env: [{name: ROS_DOMAIN_ID, value: $ROBOT_DOMAIN}]\n"
    assert "env ROS_DOMAIN_ID refers to $ROBOT_DOMAIN" in refusal(text)
    assert spec(ONE + "    env: [{name: ROS_DOMAIN_ID, value: '\"7\"'}]\n")["ros2"] == {"domain": 7}


def test_without_an_image_the_cure_fits_the_number_of_build_jobs() -> None:
    assert "add one build job" in refusal(JOBS + DEPLOY)
    two = JOBS + BUILD + BUILD.replace("  build:", "  build_arm:") + DEPLOY
    told = refusal(two)
    assert "jobs build and build_arm build one each: write the right one as application_image" in told
    assert "add one build job" not in told
