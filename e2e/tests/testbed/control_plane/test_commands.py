from pathlib import Path

import pytest

from robotapp_testbed.control_plane.commands import Commands


def commands(folder: Path, script: str) -> Commands:
    program = folder / "kubectl"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    return Commands({"kubectl": program}, folder)


def run(made: Commands, *args: str, check: bool = True, stdin: object = None) -> str:
    return made.run("kubectl", args, kubeconfig=Path("/the/kubeconfig"), stdin=stdin, check=check)


def test_the_users_own_configuration_is_never_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KUBECONFIG", "/the/users/own")
    output = run(commands(tmp_path, 'echo "$KUBECONFIG $HOME $HELM_CACHE_HOME"'))
    assert output.split() == ["/the/kubeconfig", str(tmp_path / "home"), str(tmp_path / "home" / "helm-cache")]
