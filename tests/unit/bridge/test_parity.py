"""Every row of the behaviour table of Rigel's orchestration plugin, as tests/golden/rigel_parity.yaml states it."""

import argparse
import ast
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.rigel.rigelfiles import refusal, rendered

from rigel_bridge.main import main
from rigel_bridge.render.workloads import workloads
from rigel_bridge.verbs.table import VERBS

ROOT = Path(__file__).resolve().parents[3]
ROWS: list[dict[str, Any]] = yaml.safe_load((ROOT / "tests" / "golden" / "rigel_parity.yaml").read_text())
EXAMPLES = [
    pytest.param(example, id=f"row {row['row']}: {row['feature']} ({number})")
    for row in ROWS
    for number, example in enumerate(row.get("examples", ()), start=1)
]


def test_there_are_29_rows() -> None:
    assert [row["row"] for row in ROWS] == list(range(1, 30))


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_example_becomes_what_its_row_states(example: dict[str, Any]) -> None:
    options = {"today": "2026-11-22", **example.get("options", {})}
    if "refused" in example:
        assert example["refused"] in refusal(example["rigelfile"], **options)
        return
    found = rendered(example["rigelfile"], **options)
    documents, notes = (*found.claims, found.app), found.notes
    if "format" in example:
        documents, notes = workloads(found, annotated=example["format"] == "pods")
    wanted = example.get("has", [])
    for document, part in zip(documents, wanted, strict=True) if isinstance(wanted, list) and wanted else ():
        assert_covers(document, part)
    if isinstance(wanted, dict):
        assert_covers(found.app, wanted)
    for path in example.get("absent", ()):
        assert at(found.app, path) is None
    for part in example.get("notes", ()):
        assert any(part in note for note in notes), notes


@pytest.mark.parametrize("row", [pytest.param(row, id=f"row {row['row']}") for row in ROWS if "commands" in row])
def test_the_commands_of_a_row_exist_with_their_flags(row: dict[str, Any]) -> None:
    verbs = {verb.name: verb for verb in VERBS}
    for name, flags in row["commands"].items():
        parser = argparse.ArgumentParser()
        verbs[name].arguments(parser)
        assert set(flags) <= set(parser._option_string_actions)


@pytest.mark.parametrize("row", [pytest.param(row, id=f"row {row['row']}") for row in ROWS if "proved" in row])
def test_the_tests_that_a_row_names_exist(row: dict[str, Any]) -> None:
    for named in row["proved"]:
        path, _, test = named.partition("::")
        tree = ast.parse((ROOT / path).read_text())
        assert test in {
            node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        }


@pytest.mark.parametrize("row", [pytest.param(row, id=f"row {row['row']}") for row in ROWS if "files" in row])
def test_the_examples_of_a_row_render(row: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    for folder in row["files"]:
        assert main(["render", str(ROOT / "examples" / "rigel" / folder / "Rigelfile")]) == 0
        app = yaml.safe_load(capsys.readouterr().out)
        assert len(app["spec"]["components"]) == 2


def test_every_row_is_proved() -> None:
    for row in ROWS:
        assert {"examples", "commands", "proved", "files"} & set(row), row["row"]


def assert_covers(found: Any, wanted: Any, path: str = "") -> None:
    """Whether everything wanted is there: mappings may hold more, lists are as long."""
    if isinstance(wanted, dict):
        assert isinstance(found, dict), path
        for key, value in wanted.items():
            assert key in found, f"{path}.{key}"
            assert_covers(found[key], value, f"{path}.{key}")
    elif isinstance(wanted, list):
        assert isinstance(found, list), path
        assert len(found) == len(wanted), path
        for index, (one, other) in enumerate(zip(found, wanted, strict=True)):
            assert_covers(one, other, f"{path}[{index}]")
    else:
        assert found == wanted, path


def at(document: Any, path: str) -> Any:
    for step in path.replace("[", ".[").split("."):
        if document is None:
            return None
        document = document[int(step[1:-1])] if step.startswith("[") else document.get(step)
    return document
