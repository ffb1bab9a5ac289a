"""`kubectl robotapp console` becomes the console's own program."""

import importlib.util
import os
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robotapp_cli.commands import console
from robotapp_cli.commands.console import ConsoleOptions, build_command
from robotapp_cli.main import app


def test_the_options_reach_the_console() -> None:
    url = "https://127.0.0.1:10259"
    options = ConsoleOptions(Path("/k"), "c", port=8080, browser=False, scheduler_url=url, scheduler_config="ns/other")
    assert build_command(options)[1:] == [
        "-m",
        "robotapp_console",
        "--local",
        "--port=8080",
        "--kubeconfig=/k",
        "--context=c",
        f"--scheduler-url={url}",
        "--scheduler-config=ns/other",
        "--no-browser",
    ]


def test_the_command_takes_the_place_of_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(os, "execv", lambda _program, argv: started.append(argv))
    assert CliRunner().invoke(app, ["console", "--no-browser"]).exit_code == 0
    assert started[0][1:] == ["-m", "robotapp_console", "--local", "--port=0", "--no-browser"]


def test_without_the_consoles_packages_the_command_names_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    known = importlib.util.find_spec

    def find(name: str, *more: Any) -> Any:
        return None if name == "jinja2" else known(name, *more)

    monkeypatch.setattr(console.importlib.util, "find_spec", find)
    result = CliRunner().invoke(app, ["console"])
    assert result.exit_code == 2
    assert "jinja2" in result.output
    assert "[cli,console]" in result.output
