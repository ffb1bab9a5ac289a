"""The agent's command line."""

from pathlib import Path

import pytest

from robotapp_agent.main import main
from robotapp_agent.shell.options import PROBE_PORT, parse


def test_usual_values_need_no_flags() -> None:
    found = parse([], {})
    assert (found.host_root, found.probe_port, found.service) == (Path("/"), PROBE_PORT, "robotapp-agent")
    assert (found.key_dir, found.interval_seconds, found.node_name) == (None, 0, "")


def test_a_variable_stands_for_its_flag_and_the_flag_wins() -> None:
    environment = {"ROBOTAPP_AGENT_PROBE_PORT": "7777", "ROBOTAPP_AGENT_HOST_ROOT": "/host"}
    assert parse([], environment).probe_port == 7777
    assert parse(["--probe-port=0"], environment).probe_port == 0
    assert parse([], environment).host_root == Path("/host")


@pytest.mark.parametrize(
    "argv",
    [
        ["--probe-port=70000"],
        ["--interval-seconds=9999"],
        ["--interval-seconds=-1"],
        ["--node-name=Robot 1"],
        ["--json"],
        ["extra"],
        ["--log-format=xml"],
    ],
)
def test_mistakes_end_with_the_usage(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as raised:
        parse(argv, {})
    assert raised.value.code == 2
    assert "usage: robotapp-agent" in capsys.readouterr().err


def test_a_wrong_variable_is_a_mistake_as_well() -> None:
    with pytest.raises(SystemExit):
        parse([], {"ROBOTAPP_AGENT_HEALTH_PORT": "http"})


def test_help_shows_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(["--help"], {})
    shown = capsys.readouterr().out
    assert "robotapp-agent --once --json" in shown


def test_outside_a_cluster_the_agent_ends_with_a_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("KUBERNETES_SERVICE_HOST", raising=False)
    assert main([]) == 2
    assert "no API server" in capsys.readouterr().err
