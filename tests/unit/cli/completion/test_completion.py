"""Shell completion of names: helpful, and silent when it cannot be."""

import pytest
import typer
from click import Command
from tests.unit.cli.running import INSTANCES, ROBOTAPPS, Stage, instance, robotapp

from robotapp_cli.completion import complete_names, complete_nodes, complete_pairs, complete_robots


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


def test_robots_are_those_of_the_app_on_the_command_line(stage: Stage) -> None:
    stage.add(INSTANCES, instance("amr-08"), instance("amr-07"), instance("bot-1"), instance("", app="one"))
    stage.add(INSTANCES, instance("amr-09", app="patrol"))
    given = {"kubeconfig": str(stage.kubeconfig)}
    assert complete_robots(context(**given, name="teleop"), "amr") == ["amr-07", "amr-08"]
    assert complete_robots(context(**given, name="one"), "") == []
    assert complete_robots(context(**given), "amr") == ["amr-07", "amr-08", "amr-09"]


def test_without_a_cluster_there_is_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KUBECONFIG", "/nowhere")
    assert complete_names(context(), "te") == complete_robots(context(), "te") == []
    assert complete_nodes(context(), "e") == complete_pairs(context(), "e") == []


def test_nodes_and_pairs_of_nodes_are_offered_as_far_as_they_are_typed(stage: Stage) -> None:
    stage.add("/nodes", *({"metadata": {"name": name}} for name in ("edge-1", "edge-2", "amr-07")))
    given = context(kubeconfig=str(stage.kubeconfig))
    assert complete_nodes(given, "edge") == ["edge-1", "edge-2"]
    assert complete_pairs(given, "am") == ["amr-07:"]
    assert complete_pairs(given, "edge-1:") == ["edge-1:amr-07=", "edge-1:edge-2="]
    assert complete_pairs(given, "edge-1:amr-07=") == []
