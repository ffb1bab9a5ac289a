"""Shell completion of names: helpful, and silent when it cannot be."""

import pytest
import typer
from click import Command
from tests.support.cli import ROBOTAPPS, Stage, robotapp

from robotapp_cli.completion import complete_names


def context(**params: object) -> typer.Context:
    found = typer.Context(Command("info"))
    found.params = params
    return found


def test_names_that_begin_alike_are_offered(stage: Stage) -> None:
    stage.add(
        ROBOTAPPS, robotapp("teleop"), robotapp("telemetry"), robotapp("mapper"), robotapp("team", namespace="other")
    )
    assert complete_names(context(kubeconfig=str(stage.kubeconfig)), "te") == ["telemetry", "teleop"]
    assert complete_names(context(kubeconfig=str(stage.kubeconfig), namespace="other"), "te") == ["team"]


def test_without_a_cluster_there_is_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KUBECONFIG", "/nowhere")
    assert complete_names(context(), "te") == []
