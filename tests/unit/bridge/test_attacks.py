"""Hostile Rigelfiles: they read no secrets, stay within bounds, choose no namespace and write no control characters to the terminal."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from tests.support.rigel.jobfiles import with_block
from tests.support.rigel.rigelfiles import ONE, orchestration, refusal, rendered, spec

from rigel_bridge.document import template
from rigel_bridge.document.failures import BridgeError, control_character
from rigel_bridge.document.template import MAX_EXPANDED, MAX_REPLACED, MAX_VALUE, Spent, Templates
from rigel_bridge.document.tree import parse
from rigel_bridge.main import main
from rigel_bridge.render.text import as_yaml


def chain(levels: int, times: int, last: str = "x") -> str:
    """Variables of which each stands for several of the next, and a package that uses the first."""
    rows = [f"  v{level}: '{f'{{{{v{level + 1}}}}}' * times}'" for level in range(levels)]
    return "\n".join(["vars:", *rows, f"  v{levels}: '{last}'", ONE]).replace("driver:1", "driver:{{ v0 }}")


def spent_before_refusal(text: str) -> Spent:
    """The work done for `{{ v0 }}` until it was refused, counted: the time follows from it on any machine."""
    variables = parse(text.encode(), "Rigelfile").mapping()["vars"].mapping()
    templates = Templates(variables)
    with pytest.raises(BridgeError):
        templates.render(variables["v0"], "{{ v0 }}")
    return templates.spent


def test_half_a_kilobyte_does_not_become_seven_megabytes() -> None:
    text = chain(5, 10, last="0123456789" * 7)
    assert len(text) < 600
    assert f"stand for more than {MAX_EXPANDED // 1024} KiB of text" in refusal(text)
    # The refused value is counted as well, and holds at most all that was counted before it.
    assert spent_before_refusal(text).characters <= 2 * MAX_EXPANDED + MAX_VALUE


def test_names_that_stand_for_nothing_cost_no_more() -> None:
    text = chain(9, 10, last="")
    assert f"more than {MAX_REPLACED} replaced names" in refusal(text)
    assert spent_before_refusal(text).replaced == MAX_REPLACED + 1


def test_one_long_value_many_times_is_bounded_too() -> None:
    text = f"vars: {{a: {'x' * MAX_VALUE}}}\n" + ONE.replace("driver:1", "driver:" + "{{ a }}" * 65)
    assert f"more than {MAX_EXPANDED // 1024} KiB" in refusal(text)


def test_what_many_fields_use_is_added_up() -> None:
    entries = ", ".join(f"{{name: A{index}, value: '{{{{ a }}}}'}}" for index in range(70))
    text = f"vars: {{a: {'x' * MAX_VALUE}}}\n{ONE}    env: [{entries}]\n"
    assert f"more than {MAX_EXPANDED // 1024} KiB" in refusal(text)


def test_a_long_chain_of_names_is_no_endless_recursion() -> None:
    assert "stand for one another more than 16 deep" in refusal(chain(3000, 1))


@given(
    levels=st.integers(0, 2) | st.integers(3, 20),
    times=st.integers(1, 40),
    last=st.text(alphabet="ab", max_size=30) | st.just("ab" * 15),
)
def test_what_is_rendered_is_never_larger_than_the_bound(levels: int, times: int, last: str) -> None:
    """With small bounds, which take little time to reach; the tests above use the real ones."""
    text = chain(levels, times, last).replace(
        "image: acme/driver:{{ v0 }}", "image: i\n    env: [{name: A, value: '{{ v0 }}'}]"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(template, "MAX_REPLACED", MAX_REPLACED // 100)
        patch.setattr(template, "MAX_EXPANDED", MAX_EXPANDED // 1000)
        try:
            value = spec(text)["components"][0]["env"][0]["value"]
        except BridgeError:
            return
    assert value == last * times**levels
    assert len(value) <= MAX_EXPANDED // 1000


@pytest.mark.parametrize("number", ["0x" + "f" * 6000, "0b" + "1" * 20_000, "9" * 5000, "1_" * 3000])
def test_a_number_that_python_cannot_write_is_one_short_line(number: str) -> None:
    """Of 4300 digits and more Python makes no text: that was a traceback wherever the number was shown."""
    file = f"vars: {{a: {number}}}\napplication: {{distro: humble}}\njobs:\n  deploy:\n    plugin: rigel_bridge.RobotAppPlugin\n"
    block = "    with: {name: teleop, image: 'x:{{ vars.a }}', orchestration: {}}\n"
    assert "vars.a: has " in refusal(file + block)
    assert len(refusal(ONE.replace("humble", number))) < 400


def test_a_long_value_is_not_repeated_in_the_message() -> None:
    assert len(refusal(ONE + f"    env: {'x' * 100_000}\n")) < 400


@given(st.text(alphabet="a b:#-'\"\\\n\t\x85\u2028\u202e\x1b\x9b\x7f\ufeffé{}[]&*!|>%@,?", max_size=30))
def test_what_is_rendered_turns_no_text_on_the_screen_and_means_the_same(text: str) -> None:
    """An image or argument with U+202E is shown from right to left, so that what is applied is not what was read."""
    document = {"args": [text, {text: text * 10}]}
    written = as_yaml([document])
    assert yaml.safe_load(written) == document
    assert not [line for line in written.split("\n") if control_character(line)]


class TestEnvironment:
    def test_nothing_is_taken_that_was_not_named(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hunter2")
        monkeypatch.setenv("TAG", "9")
        path = tmp_path / "Rigelfile"
        path.write_text(ONE.replace(":1", ":{{ AWS_SECRET_ACCESS_KEY }}"))
        for flags in ([], ["--env", "TAG"]):
            assert main(["render", str(path), *flags]) == 72
            told = capsys.readouterr()
            assert "hunter2" not in told.out + told.err
            assert "{{ AWS_SECRET_ACCESS_KEY }} is not in vars" in told.err
            assert "Rigel takes it from the environment, the bridge takes no secrets" in told.err

    def test_a_secret_is_not_taken_even_when_it_was_named(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hunter2")
        path = tmp_path / "Rigelfile"
        path.write_text(ONE.replace(":1", ":{{ AWS_SECRET_ACCESS_KEY }}"))
        assert main(["render", str(path), "--env", "AWS_SECRET_ACCESS_KEY"]) == 72
        told = capsys.readouterr()
        assert "hunter2" not in told.out + told.err
        assert "AWS_SECRET_ACCESS_KEY looks like a secret" in told.err

    def test_a_named_variable_that_is_not_set_is_wrong_usage(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.delenv("TAG", raising=False)
        with pytest.raises(SystemExit) as caught:
            main(["render", str(tmp_path / "Rigelfile"), "--env", "TAG"])
        assert caught.value.code == 2
        assert "argument --env: TAG: this variable is not set" in capsys.readouterr().err

    @pytest.mark.parametrize("value", ["a\x1b[2J", "a\x00", "a\nb", "a\udc80", "a\u202eb"])
    def test_a_value_with_control_characters_is_refused_before_it_is_used(self, value: str) -> None:
        text = refusal(ONE.replace(":1", ":{{ TAG }}"), environment={"TAG": value})
        assert "environment variable TAG holds a character that is not printed" in text
        assert value not in text

    def test_a_value_that_is_too_long_is_refused_before_it_is_used(self) -> None:
        text = refusal(ONE.replace(":1", ":{{ TAG }}"), environment={"TAG": "x" * (MAX_VALUE + 1)})
        assert f"environment variable TAG has {MAX_VALUE + 1} characters; allowed: {MAX_VALUE}" in text


def test_a_var_with_control_characters_is_refused_where_it_stands() -> None:
    text = refusal('vars: {tag: "a\\e[2J"}\n' + ONE.replace(":1", ":{{ tag }}"))
    assert text == "Rigelfile:1: vars.tag: holds a character that is not printed (U+001B); write plain text"


def test_a_var_of_several_lines_is_allowed() -> None:
    block = '{components: {base_driver: {env: [{name: A, value: "{{ v }}"}]}}}'
    text = 'vars: {v: "a\\n\\tb"}\n' + orchestration(block)
    assert spec(text)["components"][0]["env"] == [{"name": "A", "value": "a\n\tb"}]


class TestSecrets:
    def test_one_that_an_image_has_stays_in_the_image(self) -> None:
        found = rendered(
            ONE + "    env: [{name: API_KEY, value: hunter2}, {name: TOKENIZERS_PARALLELISM, value: 'false'}]\n"
        )
        assert found.app["spec"]["components"][0]["env"] == [{"name": "TOKENIZERS_PARALLELISM", "value": "false"}]
        assert "env API_KEY looks like a secret and is not carried over" in found.notes[0]
        assert "hunter2" not in str(found)

    def test_one_that_the_block_writes_out_is_refused(self) -> None:
        text = refusal(orchestration("components: {base_driver: {env: [{name: DB_PASSWORD, value: hunter2}]}}"))
        assert "spec.components[0].env[0] DB_PASSWORD looks like a secret: keep it in a Secret" in text
        assert "hunter2" not in text

    def test_one_that_names_a_secret_is_what_is_wanted(self) -> None:
        entry = "{name: DB_PASSWORD, valueFrom: {secretKeyRef: {name: db, key: password}}}"
        assert spec(orchestration(f"components: {{base_driver: {{env: [{entry}]}}}}"))["components"][0]["env"]


class TestNamespace:
    def test_the_file_does_not_choose_where_the_app_goes(self) -> None:
        found = rendered(orchestration("{name: x, namespace: kube-system}"))
        assert found.app["metadata"] == {"name": "x"}
        (note,) = found.notes
        assert note.endswith("namespace is not carried over: the command line names the namespace (-n), not the file")

    def test_its_value_is_not_even_rendered(self) -> None:
        assert "namespace" not in rendered(orchestration("namespace: '{{ UNSET }}'")).app["metadata"]

    def test_strict_writes_nothing(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = tmp_path / "Rigelfile"
        path.write_text(orchestration("namespace: kube-system"))
        assert main(["render", str(path), "--strict"]) == 72
        assert capsys.readouterr().out == ""

    @pytest.mark.parametrize("namespace", ["Fleet", "a/b", "a b", "-a", "x" * 64, "a\nb", ""])
    def test_the_command_lines_own_is_checked(
        self, namespace: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        path = tmp_path / "Rigelfile"
        path.write_text(ONE)
        with pytest.raises(SystemExit) as caught:
            main(["render", str(path), f"--namespace={namespace}"])
        assert caught.value.code == 2
        assert "is no name of a namespace" in capsys.readouterr().err

    def test_robotapps_own_words_reach_the_spec_only(self) -> None:
        text = refusal(orchestration("robotapp: {metadata: {namespace: kube-system}}"))
        assert text == "Rigelfile:10: spec.metadata is not a field of RobotApp"


@pytest.mark.parametrize(
    "text",
    [
        f"{ONE}    env: [{{name: ROS_DOMAIN_ID, value: {'9' * 5000}}}]\n",
        f"{ONE}    env: [{{name: ROS_DOMAIN_ID, value: '٤٢'}}]\n",
        orchestration(f"scheduler: {{dds_domain: {'9' * 5000}}}"),
        orchestration("scheduler: {dds_domain: '٤٢'}"),
    ],
)
def test_a_domain_that_is_no_small_number_is_one_error(text: str) -> None:
    assert len(refusal(text)) < 400


@pytest.mark.parametrize(
    "text",
    [
        '"\\e]0;owned\\a": 1\n' + ONE,
        f'{ONE}    "com\\nmand": x\n',
        '"a\\u202eb": 1\n' + ONE,
        ONE.replace("acme/driver:1", '["\\e[2J"]').replace("base_driver\n", '"\\e[2J"\n', 1),
        'packages: [{"\\e[2J": {}, package: a}]\n',
    ],
)
def test_a_file_writes_no_control_characters_to_the_terminal(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "Rigelfile"
    path.write_text(text)
    main(["render", str(path)])
    told = capsys.readouterr().err
    assert told
    assert all(line.isprintable() for line in told.splitlines())
    assert told.count("\n") == 1


def test_what_is_written_is_yaml_whatever_the_values_are() -> None:
    text = f"{ONE}    env: [{{name: A, value: '\\\": {{}}, kind: ClusterRole'}}]\n"
    app = rendered(text).app
    assert yaml.safe_load(yaml.safe_dump(app)) == app
    assert app["kind"] == "RobotApp"


class TestSequences:
    SWEEP = "{stages: [{matrix: {a: [1,2,3,4,5,6,7,8], b: [1,2,3,4,5,6,7,8]}, parallel: [{jobs: [deploy, deploy]}]}]}"

    def test_a_sequence_stands_for_no_more_apps_than_a_cluster_takes(self) -> None:
        assert "sequence s deploys more than 64 RobotApps" in refusal(
            with_block("{}") + f"  s: {self.SWEEP}\n", sequence="s"
        )

    def test_all_sequences_together_are_bounded(self) -> None:
        text = with_block("{}") + "".join(f"  s{number}: {self.SWEEP}\n" for number in range(5))
        assert "all sequences run more than 512 jobs" in refusal(text)


def test_what_is_written_has_an_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "Rigelfile"
    block = "{components: {ros-app: {env: [{name: A, value: '" + "x" * 20_000 + "'}]}}}"
    path.write_text(
        with_block(block)
        + "  s: {stages: [{matrix: {a: [1,2,3,4,5,6,7,8], b: [1,2,3,4,5,6,7,8]}, parallel: [{jobs: [deploy]}]}]}\n"
    )
    assert main(["render", str(path), "--sequence", "s", "--name", "a"]) == 72
    told = capsys.readouterr()
    assert told.out == ""
    assert "more than 1 MiB" in told.err
