"""Every fault of `scripts/bench mutants` still fits the product, and the copy that it is put into is what its tests use."""

import ast
import sys
from pathlib import Path

import pytest

from campaigns.mutants.catalogue import FAULTS, Fault, MissingTextError, faulty_text, put_in, select_faults, take_out
from campaigns.mutants.mutants import ROOT, Campaign, render_command
from campaigns.mutants.page import Result, render_json, render_page
from campaigns.mutants.stages import ALL, ESSENTIAL, FEW, order_folders, plan_stages
from campaigns.mutants.tree_copy import PROGRAM, TreeCopy, WrongEnvironmentError

QUICK_FAULT, LIVE_FAULT = (next(fault for fault in FAULTS if fault.live is live) for live in (False, True))


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_changes_what_the_product_does(fault: Fault) -> None:
    text = (ROOT / fault.file).read_text(encoding="utf-8")
    faulty = faulty_text(fault, text)
    if fault.file.endswith(".py"):
        assert ast.dump(ast.parse(faulty)) != ast.dump(ast.parse(text))
    else:
        assert faulty != text


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_tests_to_run_first_are_there(fault: Fault) -> None:
    assert [test for test in fault.tests if not (ROOT / test).exists()] == []
    assert fault.live_tests if fault.live else fault.quick_tests


def test_there_are_twenty_faults_of_which_a_fourth_needs_a_cluster() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) == 20
    assert len([fault for fault in FAULTS if fault.live]) >= 5
    assert {fault.file.split("/")[0] for fault in FAULTS} >= {
        *("scheduler", "operator", "claims", "client", "agent", "cli", "crds", "helm", "rigel_bridge", "ros_profile")
    }


def test_a_fault_whose_text_is_gone_is_refused(tmp_path: Path) -> None:
    file = tmp_path / QUICK_FAULT.file
    file.parent.mkdir(parents=True)
    file.write_text("other text")
    with pytest.raises(MissingTextError, match="0 times"):
        put_in(QUICK_FAULT, tmp_path)
    file.write_text(f"before {QUICK_FAULT.old} after")
    text = put_in(QUICK_FAULT, tmp_path)
    assert file.read_text() == f"before {QUICK_FAULT.new} after"
    take_out(QUICK_FAULT, tmp_path, text)
    assert file.read_text() == f"before {QUICK_FAULT.old} after"


def test_faults_that_quick_tests_notice_come_first() -> None:
    assert [fault.live for fault in select_faults(())] == sorted(fault.live for fault in FAULTS)
    assert select_faults([LIVE_FAULT.name]) == [LIVE_FAULT]


def tree_with(tmp_path: Path, essential: str) -> Path:
    for folder in ("chart", "operating", "scheduling"):
        (tmp_path / "tests" / "live" / folder).mkdir(parents=True)
        (tmp_path / "tests" / "live" / folder / "test_it.py").touch()
    (tmp_path / ESSENTIAL).write_text(essential)
    return tmp_path


def test_the_touched_packages_tests_come_first_and_the_essential_live_tests_after_all_quick_ones(
    tmp_path: Path,
) -> None:
    tree = tree_with(
        tmp_path, "# live\ntests/live/chart/test_it.py  # rendered\n\ntests/live/scheduling/test_it.py::test_a[1]\n"
    )
    fault = next(fault for fault in FAULTS if fault.name == "hint-never-wakes")
    stages = list(plan_stages(fault, tree, rest=False))
    assert [(stage.tests, stage.is_daily) for stage in stages] == [
        (fault.quick_tests, True),
        (("tests/unit", "tests/property"), True),
        (("tests/live/scheduling/test_it.py::test_a[1]",), True),
        (("tests/live/chart/test_it.py",), True),
    ]
    rest = list(plan_stages(fault, tree, rest=True))[5:]
    assert [stage.tests[0] for stage in rest] == [
        *("tests/live/scheduling", "tests/live/chart", "tests/live/operating", "e2e/tests")
    ]
    assert not any(stage.is_daily for stage in rest)


def test_what_counts_as_noticed_by_scripts_test_is_run_with_as_few_examples_as_there(tmp_path: Path) -> None:
    stages = list(plan_stages(QUICK_FAULT, tree_with(tmp_path, "tests/live/chart/test_it.py"), rest=True))
    quick = [stage for stage in stages if stage.tests[0].startswith(("tests/unit", "tests/property"))]
    assert [(stage.is_daily, stage.environment) for stage in quick] == [(True, FEW), (True, FEW), (False, ALL)]


def test_the_folder_of_the_faults_own_live_tests_leads() -> None:
    folders = ["tests/live/a", "tests/live/b"]
    assert order_folders(folders, first=()) == folders
    assert order_folders(folders, first=("tests/live/b/test_y.py",)) == folders[::-1]


PRODUCT = "def answer():\n    return 'right'\n"
FAULT = Fault(name="wrong", harm="It is wrong.", file="product.py", old="right", new="wrong", tests=("tests/unit",))


@pytest.fixture
def small_copy(tmp_path: Path) -> TreeCopy:
    """A tree with one test that notices the fault, and one that always fails; its Python is ours."""
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "python").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    (programs / "python").chmod(0o755)
    (tmp_path / "product.py").write_text(PRODUCT)
    (tmp_path / "pyproject.toml").write_text('[tool.pytest.ini_options]\npythonpath = ["."]\n')
    unit = tmp_path / "tests" / "unit"
    unit.mkdir(parents=True)
    (tmp_path / "tests" / "property").mkdir()
    (unit / "test_broken.py").write_text("def test_broken():\n    raise OSError\n")
    (unit / "test_product.py").write_text(
        "from product import answer\n\ndef test_answer():\n    assert answer() == 'right'\n"
    )
    return TreeCopy(tmp_path)


def test_a_fault_is_noticed_by_the_first_test_that_passes_without_it(small_copy: TreeCopy) -> None:
    campaign = Campaign(small_copy, rest=False, budget_s=120)
    (result,) = campaign.run([FAULT])
    assert (result.test, result.stage, result.is_daily) == (
        "tests/unit/test_product.py::test_answer",
        "own tests",
        True,
    )
    assert campaign.failing == {"tests/unit/test_broken.py::test_broken"}
    assert (small_copy.path / "product.py").read_text() == PRODUCT


def test_tests_that_take_too_long_are_ended(small_copy: TreeCopy) -> None:
    slow = small_copy.path / "tests" / "unit" / "test_slow.py"
    slow.write_text("import time\n\ndef test_slow():\n    time.sleep(600)\n")
    answer = small_copy.run_tests(["tests/unit/test_slow.py"], most_s=5)
    assert (answer.failed, answer.is_over) == ("", False)


def test_a_copy_that_uses_another_tree_is_refused(small_copy: TreeCopy) -> None:
    (small_copy.path / ".venv" / "bin" / PROGRAM).write_text(f"#!{small_copy.path}/.venv/bin/python\n")
    with pytest.raises(WrongEnvironmentError, match="robotapp_api"):
        small_copy.prove_it_is_used()


def test_the_page_counts_what_scripts_test_notices() -> None:
    results = [
        Result(QUICK_FAULT, "tests/unit/a.py::test_a[x|y]", "own tests", is_daily=True, seconds=3.4),
        Result(LIVE_FAULT, "", "live tests", is_daily=False, seconds=90.0, is_over=False),
    ]
    page = render_page(results, command="scripts/bench mutants", commit="abc")
    assert "**1 of 2 are noticed by `scripts/test`, 1 in all.**" in page
    assert "`tests/unit/a.py::test_a[x&#124;y]` | own tests | 3 s |" in page
    assert "| nothing before time ran out | live tests | 90 s |" in page
    plain = render_json(results, command="scripts/bench mutants", commit="abc")
    assert [fault["noticed_by"] for fault in plain["faults"]] == ["tests/unit/a.py::test_a[x|y]", None]  # type: ignore[attr-defined]


def test_the_command_on_the_page_leaves_out_where_it_was_written() -> None:
    words = ["--only", "rule-dropped", "--page", "docs/mutants.md", "--json=/tmp/out.json", "--rest"]
    assert render_command(words) == "scripts/bench mutants --only rule-dropped --rest"
