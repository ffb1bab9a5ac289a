"""Our own Go programs are compiled once per state of their sources."""

import io
import os
from pathlib import Path

import pytest

from robotapp_testbed.binaries import pins, programs
from robotapp_testbed.progress import Progress

GO = '#!/bin/sh\nif [ "$1" = version ]; then echo go version go1.26.0 linux/amd64; exit; fi\necho built >> "$0.log"; cp main.go "$7"\n'


@pytest.fixture
def env(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    (tmp_path / "go").write_text(GO)
    (tmp_path / "go").chmod(0o755)
    folder = tmp_path / "repository" / "e2e" / "pause"
    folder.mkdir(parents=True)
    (folder / "main.go").write_text("package main // one\n")
    (folder / "go.mod").write_text("module pause\n")
    monkeypatch.setattr(pins, "REPOSITORY", tmp_path / "repository")
    return {"PATH": f"{tmp_path}:{os.environ['PATH']}", "XDG_CACHE_HOME": str(tmp_path / "cache")}


def built(tmp_path: Path) -> int:
    return len((tmp_path / "go.log").read_text().splitlines())


def test_a_program_is_compiled_once_until_its_sources_change(tmp_path: Path, env: dict[str, str]) -> None:
    quiet = Progress(stream=io.StringIO())
    first = programs.build("pause", env=env, progress=quiet)
    assert first.read_text() == "package main // one\n"
    assert os.access(first, os.X_OK)
    assert programs.build("pause", env=env, progress=quiet) == first
    assert built(tmp_path) == 1
    (tmp_path / "repository" / "e2e" / "pause" / "main.go").write_text("package main // two\n")
    second = programs.build("pause", env=env, progress=quiet)
    assert second != first
    assert second.read_text() == "package main // two\n"


def test_tests_are_no_sources_and_go_mod_is() -> None:
    folder = pins.REPOSITORY / "e2e" / programs.FOLDERS["latency-switch"]
    names = {path.name for path in programs.sources(folder)}
    assert {"go.mod", "go.sum", "main.go", "fabric.go"} <= names
    assert not any(name.endswith("_test.go") for name in names)


@pytest.mark.parametrize("version", ["1.25.0", "1.26.9", ""])
def test_a_compiled_program_serves_whatever_go_is_there_later(
    version: str, tmp_path: Path, env: dict[str, str]
) -> None:
    quiet = Progress(stream=io.StringIO())
    first = programs.build("pause", env=env, progress=quiet)
    go = tmp_path / "go"
    go.write_text(go.read_text().replace("1.26.0", version)) if version else go.unlink()
    assert programs.build("pause", env=env | {"PATH": str(tmp_path)}, progress=quiet) == first
    assert built(tmp_path) == 1


def test_every_program_has_an_expected_duration() -> None:
    assert set(programs._COSTS) == {*programs.FOLDERS, *programs.TOOLS}


def test_every_folder_is_a_go_module() -> None:
    for folder in programs.FOLDERS.values():
        assert (pins.REPOSITORY / "e2e" / folder / "go.mod").is_file()
