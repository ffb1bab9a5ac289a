"""TAB after `rigel-bridge`: what is offered, and the script of bash as bash runs it."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.unit.bridge.fake_cluster import FakeCluster
from tests.unit.bridge.sequence_world import LIST

from rigel_bridge.main import main
from rigel_bridge.verbs import completion
from rigel_bridge.verbs.table import VERBS
from rigel_bridge.verbs.verb import Verb

Offer = Callable[..., list[str]]
SEQUENCES = ["demo", "benchmark_default", "benchmark_custom"]


@pytest.fixture
def offer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Offer:
    monkeypatch.chdir(tmp_path)
    Path("Rigelfile").write_text(LIST)

    def words(*typed: str) -> list[str]:
        assert main([completion.CALL, *typed]) == 0
        found = capsys.readouterr()
        assert found.err == ""
        return [line.partition("\t")[0] for line in found.out.splitlines()]

    return words


def test_commands_come_with_their_summary(offer: Offer, capsys: pytest.CaptureFixture[str]) -> None:
    assert offer("") == offer() == [verb.name for verb in VERBS]
    assert offer("r") == ["render", "rollback"]
    assert offer("--v") == ["--version"]
    main([completion.CALL, "dif"])
    assert capsys.readouterr().out == "diff\tshow what apply would change\n"


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.name)
def test_every_command_offers_its_flags(verb: Verb, offer: Offer) -> None:
    assert "--help" in offer(verb.name, "--")


def test_values_of_a_flag_are_offered_and_files_are_left_to_the_shell(offer: Offer) -> None:
    assert offer("render", "--format", "") == ["robotapp", "pods", "manifests"]
    assert offer("render", "--format", "=", "m") == ["manifests"], "bash makes three words of --format=m"
    assert offer("status", "-o", "j") == ["json"]
    assert offer("completion", "") == ["bash", "zsh", "fish"]
    assert offer("completion", "bash", "") == []
    assert offer("render", "") == offer("render", "-o", "") == offer("render", "--name", "") == []


def test_sequences_and_jobs_are_those_of_the_file(offer: Offer) -> None:
    assert offer("sequences", "--run", "") == SEQUENCES
    assert offer("sequences", "--run", "demo", "b") == SEQUENCES[1:], "it takes several"
    assert offer("render", "--sequence", "d") == ["demo"]
    Path("other").write_text("jobs: {go: {plugin: p.P, with: {orchestration: {}}}}\n")
    assert offer("render", "other", "--job", "") == ["go"]
    assert offer("render", "none", "--job", "") == []
    assert offer("render", "-", "--job", "") == [], "standard input is not read"


def test_names_of_apps_come_from_the_cluster_of_the_line(offer: Offer, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, list[str]]] = []

    class Listing(FakeCluster):
        def __init__(self, program: str, *, flags: list[str]) -> None:
            super().__init__()
            made.append((program, flags))

        def run(self, *arguments: str, stdin: str = "", timeout_s: float = 0) -> str:  # noqa: ARG002
            assert arguments == ("get", "robotapps.robotics.io", "-o", "name")
            assert timeout_s <= 2
            return "robotapp.robotics.io/teleop\nrobotapp.robotics.io/mapper\n"

    monkeypatch.setattr(completion, "Kubectl", Listing)
    assert offer("status", "--context", "lab", "-n", "fleet", "te") == ["teleop"]
    assert made == [("kubectl", ["--context=lab", "--namespace=fleet"])]
    assert offer("collect", "folder", "") == ["teleop", "mapper"]
    assert offer("collect", "") == [], "the first is a folder"
    assert offer("status", "teleop", "") == []


def test_without_kubectl_no_app_is_offered(offer: Offer) -> None:
    assert offer("status", "--kubectl", "no-such-kubectl", "") == []


@pytest.mark.parametrize("name", ["$(touch x)", "`touch x`", "a b", "a;b", "*", "a\\nb", "\\u202eb", "'"])
def test_a_name_that_a_shell_would_run_is_not_offered(name: str, offer: Offer) -> None:
    Path("Rigelfile").write_text(LIST.replace("  demo:", f"  {json.dumps(name)}:"))
    assert offer("sequences", "--run", "") == SEQUENCES[1:]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    words=st.lists(
        st.sampled_from(["render", "sequences", "-", "--", "--run", "--job", "=", "", "-o", "é", "\x01", "x"]),
        max_size=6,
    )
)
def test_any_line_is_completed_without_an_error(words: list[str], offer: Offer) -> None:
    offer(*words)


def test_bash_offers_what_its_script_reads(offer: Offer, tmp_path: Path) -> None:
    assert offer("sequences", "--run", "") == SEQUENCES
    program = tmp_path / "bin" / "rigel-bridge"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m rigel_bridge.main "$@"\n')
    program.chmod(0o755)
    typed = 'COMP_WORDS=(rigel-bridge {}); COMP_CWORD={}; _rigel_bridge; echo "${{#COMPREPLY[@]}}: ${{COMPREPLY[*]}}"; IFS=" "'
    script = "\n".join(
        [
            f'PATH="{program.parent}:$PATH"',
            "source <(rigel-bridge completion bash)",
            typed.format('sequences --run ""', 3),
            typed.format("ren", 1),
            typed.format('render ""', 2),
            "complete -p rigel-bridge",
        ]
    )
    bash = shutil.which("bash")
    assert bash is not None
    done = subprocess.run([bash, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stderr == ""
    assert done.stdout.splitlines() == [
        f"3: {' '.join(SEQUENCES)}",
        "1: render",
        "0: ",
        "complete -o default -F _rigel_bridge rigel-bridge",
    ]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_script_calls_the_hidden_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    assert f"rigel-bridge {completion.CALL} " in capsys.readouterr().out
