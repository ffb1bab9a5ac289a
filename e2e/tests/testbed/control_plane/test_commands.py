import json
from pathlib import Path

import pytest

from robotapp_testbed import CommandError
from robotapp_testbed.control_plane.commands import Commands, as_input
from robotapp_testbed.control_plane.product import arguments


def commands(folder: Path, script: str) -> Commands:
    program = folder / "kubectl"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    return Commands({"kubectl": program}, folder)


def run(made: Commands, *args: str, check: bool = True, stdin: object = None) -> str:
    return made.run("kubectl", args, kubeconfig=Path("/the/kubeconfig"), stdin=stdin, check=check)


def test_input_may_be_text_an_object_or_a_list() -> None:
    assert as_input(None) is None
    assert as_input("text") == "text"
    assert json.loads(as_input({"kind": "Node"}) or "") == {"kind": "Node"}
    assert json.loads(as_input([{"kind": "Node"}]) or "")["items"] == [{"kind": "Node"}]
    with pytest.raises(TypeError, match="not int"):
        as_input(7)


def test_the_users_own_configuration_is_never_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KUBECONFIG", "/the/users/own")
    output = run(commands(tmp_path, 'echo "$KUBECONFIG $HOME $HELM_CACHE_HOME"'))
    assert output.split() == ["/the/kubeconfig", str(tmp_path / "home"), str(tmp_path / "home" / "helm-cache")]


def test_a_failure_carries_what_the_program_said(tmp_path: Path) -> None:
    made = commands(tmp_path, "echo out; echo reason >&2; exit 3")
    with pytest.raises(CommandError, match="kubectl get nodes ended with 3: reason") as caught:
        run(made, "get", "nodes")
    assert (caught.value.returncode, caught.value.stdout) == (3, "out\n")


def test_a_failure_may_be_read_instead(tmp_path: Path) -> None:
    assert run(commands(tmp_path, "echo out; echo reason >&2; exit 3"), check=False) == "out\nreason\n"


def test_input_reaches_the_program(tmp_path: Path) -> None:
    assert run(commands(tmp_path, "cat"), stdin="from here") == "from here"


def test_keyword_arguments_become_flags() -> None:
    flags = {
        "sweep_seconds": 1,
        "no_leader_election": True,
        "namespaces": None,
        "verbose": False,
        "kubeconfig": Path("/k"),
    }
    assert arguments(flags) == ["--sweep-seconds", "1", "--no-leader-election", "--kubeconfig", "/k"]
