"""Templates of Rigel 0.3: headers, types, what stays, what ends in time."""

import time

import pytest
from tests.support.rigel.jobfiles import with_block
from tests.support.rigel.rigelfiles import refusal, rendered, spec
from tests.support.work_unit import unit_us


def value(
    mark: str, variables: str = "a: 1.10, b: yes, c: x, d: '{{ vars.c }}y', l: [{name: N, value: v}]", **options: object
) -> object:
    text = with_block(f"{{components: {{ros-app: {{env: [{{name: E, value: {mark}}}]}}}}}}")
    return spec("vars: {" + variables + ", " + text.removeprefix("vars: {"), **options)["components"][0]["env"][-1][
        "value"
    ]


@pytest.mark.parametrize(
    ("mark", "expected"),
    [
        ("'{{ vars.c }}'", "x"),
        ("'{{vars.c}}-{{ vars.d }}'", "x-xy"),
        ("'v{{ vars.a }}'", "v1.1"),
        ("'{{ vars.b }}!'", "True!"),
        ("'{{ vars.c | upper }}'", "{{ vars.c | upper }}"),
        ("'{{ vars.d | regex_replace(''x'', ''z'') }}'", "zy"),
    ],
)
def test_marks_stand_for_what_rigel_puts_there(mark: str, expected: str) -> None:
    assert value(mark) == expected


def test_a_mark_alone_keeps_the_type() -> None:
    assert "env[0].value must be text, found 1.1" in refusal_of("'{{ vars.a }}'")
    text = with_block("{deploy_ros_master: '{{ vars.quick }}', components: {ros-app: {replicas: '{{ vars.gpu }}'}}}")
    assert spec(text)["components"][0]["replicas"] == 1


def test_a_var_may_be_a_list_as_newer_files_have_it() -> None:
    text = with_block("{components: {ros-app: {env: '{{ vars.l }}'}}}").replace(
        "vars: {", "vars: {l: [{name: N, value: '{{ vars.distro }}'}], "
    )
    assert spec(text)["components"][0]["env"] == [{"name": "N", "value": "humble"}]


def refusal_of(mark: str, variables: str = "a: 1.10") -> str:
    text = with_block(f"{{components: {{ros-app: {{env: [{{name: E, value: {mark}}}]}}}}}}")
    return refusal(
        "vars: {" + variables + ", " + text.removeprefix("vars: {"), environment={"TAG": "1", "GH_TOKEN": "hunter2"}
    )


@pytest.mark.parametrize(
    ("mark", "variables", "message"),
    [
        (
            "'{{ image }}'",
            "a: 1",
            "{{ image }} has no header that Rigel knows; allowed: vars, data; write {{ vars.image }}",
        ),
        ("'{{ secrets.X }}'", "a: 1", "is a secret, and a RobotApp can be read by many"),
        ("'{{ vars.GH_TOKEN }}'", "a: 1", "GH_TOKEN looks like a secret"),
        (
            "'{{ vars.imag }}'",
            "a: 1",
            "{{ vars.imag }} is not in vars (did you mean image?); --env imag takes it from the environment",
        ),
        ("'{{ data.x }}'", "a: 1", "{{ data.x }} is known only while Rigel runs"),
        ("'{{ vars.a }}'", "a: '{{ vars.b }}', b: '{{ vars.a }}'", "{{ vars.a }} stands for itself: a -> b -> a"),
        ("'{{ vars.a }}'", "a: {k: '{{ vars.a }}'}", "{{ vars.a }} stands for itself: a -> a"),
        ("'-{{ vars.a }}'", "a: {k: 1}", "stands for a mapping, which is no part of a text"),
        ("'{{ vars.image | regex_replace(''(a*)*b'', '''') }}'", "a: 1", "a pattern without groups"),
        ("'{{ vars.image | regex_replace(''['', '''') }}'", "a: 1", "is no pattern"),
    ],
)
def test_what_does_not_resolve_is_refused_where_it_stands(mark: str, variables: str, message: str) -> None:
    found = refusal_of(mark, variables)
    assert message in found
    assert "hunter2" not in found


def test_lists_that_stand_for_lists_are_refused_before_they_grow() -> None:
    levels = ", ".join(f"v{n}: ['{{{{ vars.v{n + 1} }}}}', '{{{{ vars.v{n + 1} }}}}']" for n in range(15))
    assert "stand for one another more than 3 deep" in refusal_of("'{{ vars.v0 }}'", f"{levels}, v15: x")


def test_a_mark_that_stays_is_said() -> None:
    text = with_block("{components: {ros-app: {env: [{name: E, value: '{{ vars.image | upper }}'}]}}}")
    assert rendered(text).notes[-1].endswith("keeps its {{ }}: Rigel resolves no such mark")


def test_deep_lists_that_stand_for_one_another_are_refused_before_they_are_built() -> None:
    deep = "[" * 25, "]" * 25
    levels = ", ".join(f"v{n}: {deep[0]}'{{{{ vars.v{n + 1} }}}}'{deep[1]}" for n in range(15))
    assert "stand for one another more than 3 deep" in refusal_of("'{{ vars.v0 }}'", f"{levels}, v15: x")
    assert "must be text" in refusal_of(
        "'{{ vars.v0 }}'", f"v0: {deep[0]}'{{{{ vars.v1 }}}}'{deep[1]}, v1: {deep[0]}x{deep[1]}"
    )


def test_patterns_that_search_long_end_in_time() -> None:
    mark = "{{ vars.v | regex_replace('.*.*x', '') }}"
    limit_s = 20_000 * unit_us() / 1e6  # a second where nothing else runs: twice what MAX_STEPS may take
    started_s = time.process_time()
    assert "too many regex_replace" in refusal_of(f'"{mark * 50}"', f"v: {'a' * 250}")
    assert time.process_time() - started_s < limit_s
    assert value(f'"{mark * 3}"', "v: abx") == ""


def test_marks_in_keys_are_replaced_too() -> None:
    text = with_block("{components: {'{{ vars.who }}': {replicas: 2}}}").replace("vars: {", "vars: {who: ros-app, ")
    assert spec(text)["components"][0]["replicas"] == 2
    twice = text.replace("{replicas: 2}}", "{replicas: 2}, ros-app: {replicas: 3}}")
    assert "key ros-app is already in line 16" in refusal(twice)
