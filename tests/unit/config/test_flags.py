from pathlib import Path

import pytest

from robotapp_scheduler.config.flags import parse


def test_without_flags_it_runs_in_a_pod_with_the_built_in_configuration() -> None:
    found = parse([], {})
    assert found.kubeconfig is None
    assert found.config is None
    assert found.health_port == 10259
    assert found.sweep_seconds == 30.0
    assert not found.insecure_explain


def test_every_flag_is_also_a_variable_and_the_flag_wins() -> None:
    environment = {
        "ROBOTAPP_SCHEDULER_KUBECONFIG": "/k",
        "ROBOTAPP_SCHEDULER_CONFIG": "/c.yaml",
        "ROBOTAPP_SCHEDULER_SWEEP_SECONDS": "1",
        "ROBOTAPP_SCHEDULER_INSECURE_EXPLAIN": "true",
        "ROBOTAPP_SCHEDULER_LOG_FORMAT": "text",
    }
    found = parse(["--config", "/mine.yaml"], environment)
    assert (found.kubeconfig, found.config) == (Path("/k"), Path("/mine.yaml"))
    assert found.sweep_seconds == 1.0
    assert found.insecure_explain
    assert found.log_format == "text"


@pytest.mark.parametrize(
    "argv",
    [
        ["--health-port", "x"],
        ["--sweep-seconds", "-1"],
        ["--lease-namespace", "a/b"],
        ["--log-format", "xml"],
        ["--what"],
        ["simulat", "dump.json"],
    ],
)
def test_a_mistake_ends_with_a_usage_text(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        parse(argv, {})
    assert caught.value.code == 2
    assert "usage: robotapp-scheduler" in capsys.readouterr().err
