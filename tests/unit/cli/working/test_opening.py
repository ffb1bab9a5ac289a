"""`open`: what is meant, and its address."""

from pathlib import Path
from typing import Any

import pytest
from tests.unit.cli.running import ROBOTAPPS, Stage, pod, robotapp

from robotapp_cli.failures import CliError
from robotapp_cli.reading.pods import AppPod, Selection
from robotapp_cli.working.opening import Target, choose_target, find_container_port, list_targets

TELEOP = Selection("teleop")


def app_with(**fields: Any) -> dict[str, Any]:
    components = [{"name": "driver", "image": "i"}, {"name": "panel", "image": "i", **fields}]
    return robotapp(components=components)


def service(*links: dict[str, Any], **port: Any) -> dict[str, Any]:
    return {"spec": {"ports": [{"name": "ws", "port": 80, **port}]}, "links": list(links)}


def test_the_only_link_is_opened_without_its_name() -> None:
    targets = list_targets(
        app_with(service=service({"name": "view", "port": "ws", "scheme": "foxglove"}, targetPort=8765))
    )
    assert choose_target(targets, TELEOP, None) == Target("panel", "view", 8765, "foxglove")


def test_a_component_without_links_is_opened_by_its_tcp_port() -> None:
    ports = [{"containerPort": 8080, "name": "http"}, {"containerPort": 7400, "protocol": "UDP"}]
    assert choose_target(list_targets(app_with(ports=ports)), TELEOP, None) == Target("panel", "http", 8080)


def test_several_links_are_a_question_with_its_answers() -> None:
    links = ({"name": "map", "port": "ws"}, {"name": "view", "port": "ws", "path": "/v"})
    targets = list_targets(app_with(service=service(*links)))
    with pytest.raises(CliError, match="offers several addresses; open one of: panel --link map, panel --link view"):
        choose_target(targets, TELEOP, None)
    assert choose_target(targets, TELEOP, "view").path == "/v"
    with pytest.raises(CliError, match="offers no such address"):
        choose_target(targets, Selection("teleop", "driver"), None)


def test_an_app_that_offers_nothing_is_answered_with_what_to_write() -> None:
    with pytest.raises(CliError, match=r"give a component service\.links, or ports"):
        choose_target(list_targets(app_with()), TELEOP, None)


def test_a_port_is_found_by_its_name_in_the_pod() -> None:
    app_pod = AppPod(pod("a", "panel"))
    app_pod.obj["spec"]["containers"] = [{"name": "panel", "ports": [{"name": "http", "containerPort": 8080}]}]
    assert find_container_port(app_pod, Target("panel", "view", "http")) == 8080
    with pytest.raises(CliError, match="has no port named ws; name it in ports"):
        find_container_port(app_pod, Target("panel", "view", "ws"))


@pytest.fixture
def kubectl(tmp_path: Path) -> Path:
    """A kubectl that forwards to nowhere, records its arguments and ends."""
    program = tmp_path / "bin" / "kubectl"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/arguments\necho "Forwarding from 127.0.0.1:4000 -> 8765"\n')
    program.chmod(0o755)
    return program


def test_the_address_is_printed_and_the_end_of_the_connection_is_said(
    stage: Stage, kubectl: Path, tmp_path: Path
) -> None:
    links = ({"name": "view", "port": "ws", "scheme": "ws"},)
    stage.add(ROBOTAPPS, app_with(service=service(*links, targetPort=8765)))
    running_pod = pod("a", "panel", phase="Running")
    running_pod["spec"]["containers"] = [{"name": "panel"}]
    stage.add("/pods", running_pod)
    result = stage.run("open", "teleop", PATH=f"{kubectl.parent}:/bin")
    assert "amr-07/panel: ws://127.0.0.1:4000" in result.stdout
    assert result.exit_code == 1
    assert "the connection to pod a has ended" in result.stderr
    assert (tmp_path / "arguments").read_text().split() == ["port-forward", "-n", "fleet", "pod/a", ":8765"]


def test_a_forward_that_cannot_begin_is_said_in_kubectls_words(stage: Stage, kubectl: Path) -> None:
    kubectl.write_text('#!/bin/sh\necho "error: pods \\"a\\" is forbidden" >&2\nexit 1\n')
    stage.add(ROBOTAPPS, app_with(ports=[{"containerPort": 8080}]))
    running_pod = pod("a", "panel", phase="Running")
    stage.add("/pods", running_pod)
    result = stage.run("open", "teleop", PATH=f"{kubectl.parent}:/bin")
    assert (result.exit_code, 'pods "a" is forbidden' in result.stderr) == (1, True)


def test_without_kubectl_the_user_is_told_what_is_missing(stage: Stage, tmp_path: Path) -> None:
    stage.add(ROBOTAPPS, app_with(ports=[{"containerPort": 8080}]))
    stage.add("/pods", pod("a", "panel", phase="Running"))
    result = stage.run("open", "teleop", PATH=str(tmp_path))
    assert (result.exit_code, "open needs it on the PATH" in result.stderr) == (2, True)
