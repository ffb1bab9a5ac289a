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
    monkeypatch.setattr(module, "sources", lambda: sorted(tmp_path.glob("*.py")))
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
