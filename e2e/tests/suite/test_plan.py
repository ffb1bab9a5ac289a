"""What `scripts/test` runs: nothing is left out, nothing runs twice, and parts are about equally long."""

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
)

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
    chosen, postponed = choose_touched(rest, ["cli/robotapp_cli/main.py", "tests/live/cli/test_e.py"], 250)
    assert [group.name for group in chosen] == ["tests/live/cli/test_e.py", "tests/live/cli/test_a.py"]
    assert len(postponed) == 3


def test_a_file_of_the_tests_concerns_its_own_folder() -> None:
    assert find_test_folders("e2e/tests/live/switch/test_links_live.py") == ("e2e/tests/live/switch/",)
    assert find_test_folders("docs/index.md") == ()


def test_every_folder_that_the_plan_names_exists() -> None:
    named = {*EXCLUSIVE, *(folder for folders in TEST_FOLDERS.values() for folder in folders), *TEST_FOLDERS}
    assert [name for name in sorted(named) if not (landing.REPOSITORY / name).exists()] == []


def test_every_essential_entry_names_a_test_that_exists() -> None:
    for entry in read_entries(command.ESSENTIAL.read_text()):
        module, _, name = entry.partition("::")
        text = (landing.REPOSITORY / module).read_text()
        assert not name or f"def {name}(" in text, entry


def test_everything_is_the_essential_tests_and_all_parts() -> None:
    def list_selectors(*arguments: str) -> list[str]:
        entries = read_entries(command.ESSENTIAL.read_text())
        plan = command.make_plan(command.parse_arguments(arguments), entries)
        return [selector for group in plan.groups for selector in group.selectors]

    parts = [list_selectors("--part", f"{number}/{landing.PARTS}") for number in range(1, landing.PARTS + 1)]
    essential = [selector for selector in list_selectors() if selector not in {"tests/unit", "tests/property"}]
    assert sorted(list_selectors("--all")) == sorted([*essential, *(selector for part in parts for selector in part)])


def test_an_entry_with_a_comment_is_read_without_it() -> None:
    assert read_entries("# apply -> Ready\ntests/live/a.py  # 3 s\n\n") == ["tests/live/a.py"]
