"""What kubectl is told on TAB: candidates with their help, then whether names of files may follow."""

import sys
from collections.abc import Callable

import pytest
from tests.unit.cli.running import ROBOTAPPS, Stage, robotapp

from robotapp_cli.kubectl_completion import main

Ask = Callable[..., list[str]]


@pytest.fixture
def ask(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Ask:
    for name in ("_KUBECTL_ROBOTAPP_COMPLETE", "_TYPER_COMPLETE_FISH_ACTION", "_TYPER_COMPLETE_ARGS"):
        monkeypatch.setenv(name, "")  # so that what it sets is taken back

    def lines(*words: str) -> list[str]:
        monkeypatch.setattr(sys, "argv", ["kubectl_complete-robotapp", *words])
        main()
        return capsys.readouterr().out.splitlines()

    return lines


def test_commands_options_and_values_are_offered_and_no_files_beside_them(ask: Ask) -> None:
    commands = ask("")
    assert {"list", "info", "explain", "lint"} <= {line.partition("\t")[0] for line in commands}
    assert commands[-1] == ":4"
    assert ask("list", "--all") == ["--all-namespaces\tAll namespaces.", ":4"]
    assert ask("list", "-o", "") == ["table", "wide", "json", "yaml", ":4"]


def test_names_come_from_the_cluster(stage: Stage, ask: Ask) -> None:
    stage.add(ROBOTAPPS, robotapp("teleop"), robotapp("telemetry"), robotapp("mapper"))
    assert ask("info", "--kubeconfig", str(stage.kubeconfig), "te") == ["telemetry", "teleop", ":4"]


@pytest.mark.parametrize("words", [("render", "-f", ""), ("simulate", ""), ("lint", ""), ("info", "it's \"odd")])
def test_where_nothing_is_known_the_shell_may_offer_files(ask: Ask, words: tuple[str, ...]) -> None:
    assert ask(*words) == [":0"]
