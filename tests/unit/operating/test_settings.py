"""Flags and their environment variables."""

from pathlib import Path

import pytest

from robotapp_operator.settings import Settings, parse


def test_defaults_are_those_of_a_pod() -> None:
    assert parse([], {}) == Settings()


def test_every_flag_is_understood() -> None:
    argv = [
        "--kubeconfig=/k",
        "--namespaces=a, b",
        "--sweep-seconds=1",
        "--handover-seconds=2",
        "--health-port=0",
        "--scheduler-name=volcano",
        "--lease-namespace=ns",
        "--no-leader-election",
        "--log-format=json",
    ]
    assert parse(argv, {}) == Settings(
        kubeconfig=Path("/k"),
        namespaces=("a", "b"),
        sweep_seconds=1.0,
        handover_seconds=2.0,
        health_port=0,
        scheduler_name="volcano",
        lease_namespace="ns",
        leader_election=False,
        log_format="json",
    )


def test_the_family_of_the_pods_is_that_of_the_api_server_unless_a_flag_names_it() -> None:
    assert parse([], {"KUBERNETES_SERVICE_HOST": "10.96.0.1"}).ip_family == "IPv4"
    assert parse([], {"KUBERNETES_SERVICE_HOST": "fd00::1"}).ip_family == "IPv6"
    assert parse(["--ip-family=IPv4"], {"KUBERNETES_SERVICE_HOST": "fd00::1"}).ip_family == "IPv4"
    assert parse([], {"ROBOTAPP_OPERATOR_IP_FAMILY": "IPv6"}).ip_family == "IPv6"


def test_the_environment_sets_what_no_flag_does() -> None:
    environ = {
        "ROBOTAPP_OPERATOR_KUBECONFIG": "/k",
        "ROBOTAPP_OPERATOR_NAMESPACES": "a,b",
        "ROBOTAPP_OPERATOR_SWEEP_SECONDS": "7",
        "ROBOTAPP_OPERATOR_NO_LEADER_ELECTION": "true",
    }
    found = parse(["--sweep-seconds=1"], environ)
    assert found.kubeconfig == Path("/k")
    assert found.namespaces == ("a", "b")
    assert found.sweep_seconds == 1
    assert not found.leader_election


@pytest.mark.parametrize(
    "flag",
    [
        "--sweep-seconds=0",
        "--handover-seconds=nan",
        "--ip-family=ipv6",
        "--health-port=70000",
        "--namespaces=a,b c",
        "--lease-namespace=a/b",
        "--log-format=xml",
        "--unknown",
    ],
)
def test_wrong_values_are_refused_with_a_sentence(flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse([flag], {})
    assert "error:" in capsys.readouterr().err
