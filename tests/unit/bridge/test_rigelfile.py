"""The format of Rigel 0.2: what is read, what is said about the rest; templates."""

import pytest
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration, refusal, rendered, spec


def test_a_package_becomes_a_component_with_its_command_as_arguments() -> None:
    (component,) = spec(ONE)["components"]
    assert component == {
        "name": "base-driver",
        "image": "acme/driver:1",
        "args": ["ros2", "run", "base_driver", "driver"],
    }
    assert spec(ONE)["ros"] == {"distro": "humble"}


def test_a_package_with_its_own_dockerfile_needs_no_distro_or_command() -> None:
    component = spec(TWO)["components"][1]
    assert component == {"name": "operator-ui", "image": "acme/ui:1"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("packages: []\n", "Rigelfile:1: packages needs at least one entry"),
        ("vars: {}\n", "or orchestration is missing; found vars"),
        ("- a\n", "Rigelfile:1: expected a mapping, found a list"),
        ("packages:\n  - image: x\n", "Rigelfile:2: packages[0]: package is missing"),
        ("packages:\n  - {package: a, image: b, distro: humble}\n", "Rigelfile:2: packages[0]: command is missing"),
        (
            ONE.replace("humble", "no"),
            "Rigelfile:3: packages[0].distro: expected text, found true or false (no); put it in quotes",
        ),
        (
            ONE.replace("image: acme/driver:1", "image: [x]"),
            "Rigelfile:4: packages[0].image: expected text, found a list",
        ),
        (ONE + ONE.removeprefix("packages:\n"), "Rigelfile:6: packages[1]: package base_driver is already in line 2"),
        (ONE + "    env: [{name: A, valeu: b}]\n", "did you mean value?"),
        (ONE.replace("driver\n", 'driver "\n', 2), "command: No closing quotation"),
    ],
)
def test_an_unsound_file_is_refused_with_its_line(text: str, message: str) -> None:
    assert message in refusal(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "pakages: []\n" + ONE,
            "Rigelfile:1: pakages: is not known in a Rigelfile of generation g1 (did you mean packages?)",
        ),
        (ONE + "    comand: x\n", "Rigelfile:6: packages[0].comand: is not known here (did you mean command?)"),
    ],
)
def test_a_key_that_rigel_would_ignore_in_silence_is_an_error(text: str, message: str) -> None:
    assert message in refusal(text)


def test_build_time_fields_and_secrets_never_reach_the_app() -> None:
    text = (
        ONE
        + "    registry: {server: s, username: u, password: '{{ UNSET_TOKEN }}'}\n    ssh: [{hostname: h, value: KEY}]\n"
    )
    assert set(spec(text)["components"][0]) == {"name", "image", "args"}


def test_environment_variables_are_taken_as_typed() -> None:
    entries = "{name: A, value: on}, {name: B, value: 010}, {name: C, value: '{{ v }}'}, {name: D}"
    component = spec(f"vars: {{v: x}}\n{ONE}    env: [{entries}]\n")["components"][0]
    assert component["env"] == [
        {"name": "A", "value": "on"},
        {"name": "B", "value": "010"},
        {"name": "C", "value": "x"},
        {"name": "D", "value": ""},
    ]


def test_what_all_components_share_moves_to_ros2() -> None:
    text = (
        ONE
        + "    env: [{name: RMW_IMPLEMENTATION, value: rmw_cyclonedds_cpp}, {name: ROS_DOMAIN_ID, value: 42}, {name: A, value: b}]\n"
    )
    found = spec(text)
    assert found["ros2"] == {"rmw": "rmw_cyclonedds_cpp", "domain": 42}
    assert found["components"][0]["env"] == [{"name": "A", "value": "b"}]


def test_packages_of_two_distros_cannot_be_one_app() -> None:
    text = ONE + ONE.removeprefix("packages:\n").replace("base_driver", "other").replace("humble", "jazzy")
    assert refusal(text) == "Rigelfile:6: packages[1]: spec.ros.distro is 'humble' by line 2, 'jazzy' here: keep one"


class TestTemplates:
    def test_vars_come_before_the_environment(self) -> None:
        text = "vars: {d: jazzy}\n" + ONE.replace("humble", '"{{ d }}"').replace(":1", ":{{TAG}}")
        found = spec(text, environment={"d": "noetic", "TAG": "7"})
        assert (found["ros"]["distro"], found["components"][0]["image"]) == ("jazzy", "acme/driver:7")

    def test_a_var_may_use_another(self) -> None:
        text = "vars: {a: '{{ b }}-x', b: y}\n" + ONE.replace(":1", ":{{ a }}")
        assert spec(text)["components"][0]["image"] == "acme/driver:y-x"

    def test_a_var_that_stands_for_itself_is_refused(self) -> None:
        text = "vars: {a: '{{ b }}', b: '{{ a }}'}\n" + ONE.replace(":1", ":{{ a }}")
        assert "{{ a }} stands for itself: a -> b -> a" in refusal(text)

    def test_an_unknown_name_is_refused_with_the_nearest(self) -> None:
        text = "vars: {tag: x}\n" + ONE.replace(":1", ":{{ tga }}")
        assert (
            refusal(text)
            == "Rigelfile:5: packages[0].image: {{ tga }} is not in vars (did you mean tag?); --env tga takes it from the environment"
        )

    def test_a_number_in_vars_is_refused_where_it_stands(self) -> None:
        text = "vars: {tag: 1.4}\n" + ONE.replace(":1", ":{{ tag }}")
        assert (
            refusal(text)
            == "Rigelfile:1: vars.tag: must be text for {{ tag }} in packages[0].image, found a number (1.4); put it in quotes"
        )

    @pytest.mark.parametrize("mark", ["{{ vars.x }}", "{{ x | lower }}", "{ x }"])
    def test_what_rigel_leaves_alone_stays(self, mark: str) -> None:
        text = f"vars: {{x: y}}\n{ONE}    env: [{{name: A, value: '{mark}'}}]\n"
        assert spec(text)["components"][0]["env"][0]["value"] == mark

    def test_only_what_is_used_must_resolve(self) -> None:
        assert spec(orchestration("name: x") + "simulate: {plugins: ['{{ NEVER }}']}\n")


def test_two_orchestration_blocks_are_refused() -> None:
    text = "orchestration: {name: a}\n" + orchestration("name: b")
    assert "orchestration is already in line 1: keep one" in refusal(text)


def test_the_block_may_stand_at_the_top_as_in_older_descriptions() -> None:
    assert rendered("orchestration: {name: a}\n" + ONE).app["metadata"]["name"] == "a"
