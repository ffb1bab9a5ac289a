"""The check of sizes finds what it is for, and the tree passes it."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[3] / "scripts" / "sizes.py"


@pytest.fixture
def sizes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, looking at an empty tree."""
    spec = importlib.util.spec_from_file_location("sizes", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "sources", lambda: sorted(tmp_path.rglob("*.py")))
    monkeypatch.setattr("sys.argv", ["sizes.py"])
    return module


def test_long_files_and_functions_are_named_with_their_length(
    sizes: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "short.py").write_text("def f():\n" + "    x = 1\n" * 59)
    assert sizes.main() == 0
    (tmp_path / "deep.py").write_text("class A:\n    async def g(self):\n" + "        x = 1\n" * 60)
    (tmp_path / "long.py").write_text("x = 1\n" * 601)
    assert sizes.main() == 1
    said = capsys.readouterr().out
    assert "deep.py:g: 61 lines, at most 60" in said
    assert "long.py: 601 lines, at most 600" in said
    assert "short.py" not in said


def test_an_exception_holds_while_it_is_needed(
    sizes: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "long.py").write_text("x = 1\n" * 601)
    monkeypatch.setattr(sizes, "EXCEPTIONS", {"long.py": "a table"})
    assert sizes.main() == 0
    (tmp_path / "long.py").write_text("x = 1\n")
    assert sizes.main() == 1
    assert "is not too long any more" in capsys.readouterr().out


def test_a_folder_with_too_many_files_is_named(
    sizes: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cli/verbs").mkdir(parents=True)
    for number in range(14):
        (tmp_path / "cli/verbs" / f"module_{number}.py").touch()
    assert sizes.main() == 0
    (tmp_path / "cli/verbs/__init__.py").touch()
    assert sizes.main() == 1
    assert capsys.readouterr().out.startswith("cli/verbs: 15 Python files, at most 14: ")


def test_the_figures_are_those_of_the_scheduler(
    sizes: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scheduler").mkdir()
    (tmp_path / "scheduler" / "__init__.py").write_text("class Package:\n    pass\n")
    (tmp_path / "scheduler" / "small.py").write_text("class Outer:\n    class Inner:\n        pass\n")
    (tmp_path / "scheduler" / "long.py").write_text("x = 1\n" * 61)
    (tmp_path / "other.py").write_text("class Elsewhere:\n    pass\n")
    monkeypatch.setattr("sys.argv", ["sizes.py", "--figures"])
    assert sizes.main() == 0
    assert capsys.readouterr().out.splitlines() == [
        "2 modules, 64 lines, 3 classes",
        "median module 32 lines, 1 below 60",
        "   3 scheduler/small.py",
    ]
