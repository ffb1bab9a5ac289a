"""What `scripts/test` runs: nothing is left out, nothing runs twice, and parts are about equally long."""

import ast
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import suite.__main__ as command
from suite import landing
from suite.plan import (
    EXCLUSIVE,
    TEST_FOLDERS,
    Group,
    choose_touched,
    cut_parts,
    find_test_folders,
    join_groups,
    plan_essential,
    plan_rest,
    read_entries,
    take_turn,
)
from suite.repository import REPOSITORY, list_names

MODULES = [f"tests/live/{folder}/test_{name}.py" for folder in ("cli", "claims", "operating") for name in "abcde"]
groups = st.lists(
    st.builds(Group, st.sampled_from(MODULES), st.just(()), st.floats(0.1, 300)),
    max_size=40,
    unique_by=lambda g: g.name,
)


@given(groups, st.integers(1, 10))
def test_parts_hold_each_group_once_and_in_order(planned: list[Group], count: int) -> None:
    parts = cut_parts(planned, count)
    assert len(parts) == count
    assert [group for part in parts for group in part] == planned


@given(groups, st.integers(1, 10))
def test_no_part_is_longer_than_its_share_and_one_group(planned: list[Group], count: int) -> None:
    total = sum(group.seconds for group in planned)
    longest = max((group.seconds for group in planned), default=0)
    for part in cut_parts(planned, count):
        assert sum(group.seconds for group in part) <= total / count + longest + 1e-6


@given(st.sets(st.sampled_from(MODULES)), st.sets(st.sampled_from([f"{module}::test_one" for module in MODULES])))
def test_essential_tests_and_the_rest_are_all_tests_and_share_none(whole: set[str], single: set[str]) -> None:
    entries = sorted(whole | {entry for entry in single if entry.partition("::")[0] not in whole})
    rest = plan_rest(MODULES, entries, {})
    assert {group.name for group in rest} | whole == set(MODULES)
    assert not {group.name for group in rest} & whole
    deselected = {entry for group in rest for entry in group.deselected}
    assert deselected == {entry for entry in entries if "::" in entry}
    selected = [selector for group in plan_essential(entries, {}) for selector in group.selectors]
    assert sorted(selected) == entries


def test_groups_of_a_folder_are_one_process_and_exclusive_ones_stay_apart() -> None:
    modules = [
        "tests/live/scheduling/pods/test_cost_per_pod.py",
        "tests/live/scheduling/test_a.py",
        "tests/live/scheduling/test_b.py",
    ]
    joined = join_groups(plan_rest(modules, [], {}))
    assert sorted((group.exclusive, len(group.selectors)) for group in joined) == [(False, 2), (True, 1)]


def test_what_a_changed_file_concerns_runs_within_the_budget_and_the_rest_is_named() -> None:
    measured = dict.fromkeys(MODULES, 100.0)
    rest = plan_rest(MODULES, [], measured)
    chosen, postponed = choose_touched(rest, iter(["cli/robotapp_cli/main.py", "tests/live/cli/test_e.py"]), 250)
    assert [group.name for group in chosen] == ["tests/live/cli/test_e.py", "tests/live/cli/test_a.py"]
    assert len(postponed) == 3


def test_a_file_of_the_tests_concerns_its_own_folder_and_one_of_the_product_all_that_test_it() -> None:
    assert find_test_folders("e2e/tests/live/switch/test_links_live.py") == ("e2e/tests/live/switch/",)
    assert find_test_folders("tests/live/conftest.py") == ("tests/live/",)
    assert set(find_test_folders("e2e/robotapp_testbed/real/box.py")) > {"tests/live/nodes/", "e2e/tests/testbed/"}
    assert find_test_folders("README.md") == ()


def test_every_folder_concerns_tests_or_is_listed_as_one_that_does_not() -> None:
    """Tests without a control plane, and what only they use, run in any case."""
    depths = {"tests": 2, "e2e": 2, "tests/support": 3}
    folders = set()
    for name in list_names("ls-files", "-z"):
        words = name.split("/")
        depth = depths.get("/".join(words[:2]), depths.get(words[0], 1))
        folders.add("/".join((*words[:depth], "file")[: len(words)]))
    uncovered = {name for name in folders if not find_test_folders(name)}
    documents = {".gitignore", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "README.md", "SECURITY.md"}
    without_plane = {".ci/file", "scripts/file", "tests/unit/file", "tests/property/file"}
    without_plane |= {"tests/support/bags.py", "tests/support/connect_proxy.py", "tests/support/scripted.py"}
    assert uncovered == {*documents, *without_plane, "tests/essential.txt"}


def list_helpers(module: Path) -> set[str]:
    """Returns the files or folders of tests/support and e2e/campaigns from which a module imports."""
    imports = (node for node in ast.walk(ast.parse(module.read_text())) if isinstance(node, ast.ImportFrom))
    names = [f"{node.module}.{alias.name}".split(".") for node in imports for alias in node.names]
    paths = {"/".join(words[:3]) for words in names if words[:2] == ["tests", "support"]}
    paths |= {f"e2e/campaigns/{words[1]}" for words in names if words[0] == "campaigns"}
    return {f"{path}/file" if (REPOSITORY / path).is_dir() else f"{path}.py" for path in paths}


def test_a_helper_concerns_every_folder_whose_tests_import_it() -> None:
    missing = set()
    for path in list_names("ls-files", "-z", "tests/live/*/*.py", "e2e/tests/*/*.py"):
        (folder,) = find_test_folders(path)
        for helper in list_helpers(REPOSITORY / path):
            concerned = find_test_folders(helper)
            if not any(folder.startswith(start) or start.startswith(folder) for start in concerned):
                missing.add(f"{helper} concerns {folder}")
    assert missing == set()


@given(st.lists(groups, min_size=60, max_size=60), st.integers(2, 8))
def test_whatever_is_added_removed_or_measured_anew_nothing_waits_longer_than_two_rounds(
    plans: list[list[Group]], parts: int
) -> None:
    waiting: list[str] = []
    unrun: dict[str, int] = {}
    for planned in plans:
        turn, waiting = take_turn(planned, waiting, parts)
        names = {group.name for group in planned}
        unrun = {name: unrun.get(name, 0) + 1 for name in names - {group.name for group in turn}}
        assert all(count <= 2 * len(MODULES) for count in unrun.values())
        assert turn or not planned


def test_the_turns_of_a_round_are_the_parts() -> None:
    rest = plan_rest(MODULES, [], {module: 10.0 + number for number, module in enumerate(MODULES)})
    waiting: list[str] = []
    turns = []
    for _ in range(landing.LANDINGS_PER_ROUND):
        turn, waiting = take_turn(rest, waiting, landing.LANDINGS_PER_ROUND)
        turns.append(turn)
        if not waiting:
            break
    parts = cut_parts(rest, landing.LANDINGS_PER_ROUND)
    assert parts == turns + [[]] * (len(parts) - len(turns))
    assert sorted(group.name for turn in turns for group in turn) == sorted(MODULES)


def test_every_folder_that_the_plan_names_exists() -> None:
    named = {*EXCLUSIVE, *(folder for folders in TEST_FOLDERS.values() for folder in folders), *TEST_FOLDERS}
    assert [name for name in sorted(named) if not (REPOSITORY / name).exists()] == []


def test_every_essential_entry_names_a_test_that_exists() -> None:
    for entry in read_entries(command.ESSENTIAL.read_text()):
        module, _, name = entry.partition("::")
        text = (REPOSITORY / module).read_text()
        assert not name or f"def {name}(" in text, entry


def test_no_essential_test_is_the_beginning_of_another_name() -> None:
    """pytest deselects by the beginning of an id."""
    for entry in read_entries(command.ESSENTIAL.read_text()):
        module, _, name = entry.partition("::")
        text = (REPOSITORY / module).read_text() if name else ""
        assert text.count(f"def {name}") <= 1, entry


def test_everything_is_the_essential_tests_and_all_parts() -> None:
    def list_selectors(*arguments: str) -> list[str]:
        entries = read_entries(command.ESSENTIAL.read_text())
        plan = command.make_plan(command.parse_arguments(arguments), entries)
        return [selector for group in plan.list_groups() for selector in group.selectors]

    parts = [
        list_selectors("--part", f"{number}/{landing.LANDINGS_PER_ROUND}")
        for number in range(1, landing.LANDINGS_PER_ROUND + 1)
    ]
    essential = [selector for selector in list_selectors() if selector not in {"tests/unit", "tests/property"}]
    assert sorted(list_selectors("--all")) == sorted([*essential, *(selector for part in parts for selector in part)])


@pytest.mark.parametrize("arguments", [(), ("--all",), ("--part", "1/1")])
def test_no_two_groups_of_a_run_have_the_same_name(arguments: tuple[str, ...]) -> None:
    plan = command.make_plan(command.parse_arguments(arguments), read_entries(command.ESSENTIAL.read_text()))
    names = [group.name for group in plan.list_groups()]
    assert sorted(set(names)) == sorted(names)


def test_an_entry_with_a_comment_is_read_without_it() -> None:
    assert read_entries("# apply -> Ready\ntests/live/a.py  # 3 s\n\n") == ["tests/live/a.py"]
