"""Plans a run of the tests: which groups of tests there are, and which of them make a part. Pure.

A *group* is one pytest process: the tests of one folder, with one control plane. The *essential* tests, listed in
tests/essential.txt, prove each path that a user takes; everything else is *the rest*, which is cut into parts of about
equal length by measured durations.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

UNKNOWN_SECONDS: Final = 20.0
"""Duration of a module that has not been measured yet."""
QUICK_FOLDERS: Final = ("tests/unit", "tests/property")
"""Tests without a control plane: up to four workers share them."""
EXCLUSIVE: Final = (
    "tests/live/nodes",
    "tests/live/speed",
    "tests/live/images",
    "tests/live/reference/nodes",
    "tests/live/scheduling/pods/test_cost_per_pod.py",
    "e2e/tests/live/switch",
)
"""Folders and modules that measure the machine or fill it: nothing else runs beside them."""

Variables = tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Group:
    """Tests for one pytest process.

    `selectors` are paths or test ids, `deselected` ids or paths to leave out, `seconds` the expected duration. `exclusive`
    groups run alone; those `on_all_cores` are spread over up to four workers, the others are one process with one control plane.
    `variables` are set in its environment where the user has not set them.
    """

    name: str
    selectors: tuple[str, ...]
    seconds: float
    deselected: tuple[str, ...] = ()
    exclusive: bool = False
    on_all_cores: bool = False
    variables: Variables = ()


def read_entries(text: str) -> list[str]:
    """Returns the paths and test ids of tests/essential.txt: one a line, `#` begins a comment."""
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    return [line for line in lines if line]


def plan_essential(entries: Sequence[str], durations: Mapping[str, float]) -> list[Group]:
    """Groups the essential live tests by folder, the longest first. Durations are per entry, in seconds."""
    folders: dict[str, list[str]] = defaultdict(list)
    for entry in entries:
        folders[_group_name(_module_of(entry))].append(entry)
    groups = [
        Group(
            name=folder,
            selectors=tuple(selectors),
            seconds=sum(durations.get(selector, UNKNOWN_SECONDS) for selector in selectors),
            exclusive=folder.startswith(EXCLUSIVE),
        )
        for folder, selectors in folders.items()
    ]
    return sorted(groups, key=lambda group: -group.seconds)


def plan_rest(modules: Iterable[str], entries: Sequence[str], durations: Mapping[str, float]) -> list[Group]:
    """Returns one group per module of live tests that is not wholly essential, ordered by path.

    Essential tests inside a module are deselected: `scripts/test` runs them anyway.
    """
    essential = set(entries)
    groups = []
    for module in sorted(set(modules) - essential):
        inside = tuple(entry for entry in entries if entry.startswith(f"{module}::"))
        module_seconds = durations.get(module, UNKNOWN_SECONDS)
        seconds = max(1.0, module_seconds - sum(durations.get(entry, 0.0) for entry in inside))
        groups.append(Group(module, (module,), seconds, inside, module.startswith(EXCLUSIVE)))
    return groups


def join_groups(groups: Iterable[Group]) -> list[Group]:
    """Joins groups of the rest by folder into one process each, the longest first. All run with the same variables.

    Their names differ from those of the essential groups: a run may have both of a folder.
    """
    folders: dict[tuple[str, bool], list[Group]] = defaultdict(list)
    processes = []
    for group in groups:
        if group.on_all_cores:
            processes.append(group)
        else:
            folders[_group_name(group.name), group.exclusive].append(group)
    for (folder, exclusive), members in folders.items():
        processes.append(
            Group(
                name=f"{folder}, rest, alone" if exclusive else f"{folder}, rest",
                selectors=tuple(selector for member in members for selector in member.selectors),
                seconds=sum(member.seconds for member in members),
                deselected=tuple(entry for member in members for entry in member.deselected),
                exclusive=exclusive,
                variables=members[0].variables,
            )
        )
    return sorted(processes, key=lambda group: -group.seconds)


def list_folders(groups: Iterable[Group]) -> list[str]:
    """Returns the folders of the groups, each once, in the order in which they come."""
    return list(dict.fromkeys(_group_name(group.name) for group in groups))


def cut_parts(groups: Sequence[Group], count: int) -> list[list[Group]]:
    """Cuts the groups, in their order, into `count` parts: the turns of one round. The last ones may be empty."""
    parts = []
    waiting_names: list[str] = []
    for number in range(count):
        turn, waiting_names = take_turn(groups, waiting_names, count) if not number or waiting_names else ([], [])
        parts.append(turn)
    return parts


def choose_touched(
    groups: Sequence[Group], changed_files: Iterable[str], budget_s: float
) -> tuple[list[Group], list[Group]]:
    """Returns the groups that changed files concern, as many as fit into the budget (seconds), and those left out.

    Changed tests come first, then the shortest.
    """
    changed_names = set(changed_files)
    folders = {folder for name in changed_names for folder in find_test_folders(name)}
    concerned_groups = [
        group for group in groups if group.name in changed_names or group.name.startswith(tuple(folders))
    ]
    chosen: list[Group] = []
    later_groups: list[Group] = []
    remaining_s = budget_s
    for group in sorted(concerned_groups, key=lambda group: (group.name not in changed_names, group.seconds)):
        if group.seconds <= remaining_s:
            remaining_s -= group.seconds
            chosen.append(group)
        else:
            later_groups.append(group)
    return chosen, later_groups


ALL_OF_THE_REST: Final = ("tests/live/", "e2e/tests/")
"""Folders of tests that a file concerns on which all depend: the budget of a landing takes the shortest of them."""
TEST_FOLDERS: Final[Mapping[str, tuple[str, ...]]] = {
    "conftest.py": ALL_OF_THE_REST,
    "pyproject.toml": ALL_OF_THE_REST,
    "uv.lock": ALL_OF_THE_REST,
    "agent/": ("tests/live/agent/",),
    "claims/": ("tests/live/claims/",),
    "cli/": ("tests/live/cli/",),  # all of them are essential ones today
    "client/": ("tests/live/client/",),
    "console/": ("tests/live/console/", "tests/live/browser/", "tests/live/chart/test_console_objects.py"),
    "crds/": ("tests/live/crds/", "tests/live/peer_examples/"),
    "examples/reference/": ("tests/live/reference/", "e2e/tests/live/testbed/test_tutorials.py"),
    "examples/": ("e2e/tests/live/testbed/test_detached.py", "tests/live/journeys/"),
    "docs/tutorials/": ("e2e/tests/live/testbed/test_tutorials.py",),
    "docs/": ("e2e/tests/live/testbed/test_detached.py", "tests/live/peer_examples/"),
    "helm/": ("tests/live/chart/", "tests/live/attacks/"),
    "operator/": (
        "tests/live/operating/",
        "tests/live/journeys/",
        "tests/live/crash/",
        "tests/live/peer_examples/",
    ),
    "recorder/": ("tests/live/nodes/ros/test_recordings.py",),
    "rigel_bridge/": ("tests/live/bridge/",),
    "ros_profile/": ("tests/live/bridge/test_cluster_live.py",),
    "scheduler/": ("tests/live/scheduling/", "tests/live/faults/"),
    "e2e/robotapp_testbed/browser/": ("tests/live/browser/",),
    "e2e/robotapp_testbed/images/": ("tests/live/images/", "tests/live/reference/"),
    "e2e/robotapp_testbed/real/": ("tests/live/nodes/",),
    "e2e/robotapp_testbed/": ("e2e/tests/live/testbed/", "e2e/tests/testbed/"),
    "e2e/controlplane/": ("e2e/tests/live/testbed/",),
    "e2e/cel_cost/": ("tests/live/crds/",),
    "e2e/cluster_dns/": ("tests/live/nodes/",),
    "e2e/container_runtime/": ("tests/live/nodes/",),
    "e2e/kueue/": ("e2e/tests/campaigns/kueue/",),
    "e2e/pause/": ("tests/live/nodes/",),
    "e2e/latency_switch/": ("e2e/tests/live/switch/",),
    "e2e/ros_nodes/": (
        "e2e/tests/ros_nodes/",
        "tests/live/nodes/test_teleoperation.py",
        "tests/live/nodes/ros/test_real_ros.py",
    ),
    "e2e/suite/": ("e2e/tests/suite/",),
    "e2e/journeys/": ("e2e/tests/live/testbed/",),
    "e2e/campaigns/": ("e2e/tests/campaigns/",),
    "e2e/campaigns/bridge/": ("tests/live/bridge/",),
    "e2e/campaigns/common/": ("tests/live/attacks/", "tests/live/operating/"),
    "e2e/campaigns/crash/": ("tests/live/crash/",),
    "e2e/campaigns/faults/": ("tests/live/faults/",),
    "e2e/campaigns/free_api/": ("tests/live/scheduling/",),
    "e2e/campaigns/fuzz/": ("tests/live/attacks/",),
    "e2e/campaigns/hostile/": ("tests/live/attacks/",),
    "e2e/campaigns/network/": ("tests/live/agent/", "e2e/tests/live/switch/"),
    "e2e/campaigns/nodes/": ("tests/live/nodes/", "tests/live/reference/", "e2e/tests/live/testbed/"),
    "e2e/campaigns/operating/": (
        "tests/live/operating/",
        "tests/live/journeys/",
        "tests/live/nodes/ros/test_work_that_ends.py",
    ),
    "e2e/campaigns/parity/": ("tests/live/scheduling/pods/test_parity_live.py",),
    "e2e/campaigns/reference/": ("tests/live/reference/", "tests/live/nodes/ros/test_work_that_ends.py"),
    "e2e/campaigns/restore/": ("tests/live/faults/",),
    "e2e/campaigns/rigs/": ALL_OF_THE_REST,
    "e2e/campaigns/scenarios/": ("tests/live/scheduling/ros/test_scenarios_live.py",),
    "e2e/campaigns/scheduler/": ("tests/live/scheduling/", "tests/live/speed/"),
    "e2e/campaigns/speed/": ("tests/live/speed/",),
    "e2e/campaigns/storm/": (
        "tests/live/claims/",
        "tests/live/operating/",
        "tests/live/nodes/ros/test_work_that_ends.py",
    ),
    "e2e/campaigns/truth/": ("tests/live/journeys/",),
    "e2e/campaigns/versions/": ("tests/live/chart/",),
    "tests/golden/": ("tests/live/bridge/test_cluster_live.py",),
    "tests/support/agent/": ("tests/live/agent/",),
    "tests/support/apiobjects.py": (
        "tests/live/attacks/",
        "tests/live/crds/",
        "tests/live/journeys/",
        "tests/live/scheduling/",
    ),
    "tests/support/apiserver/": ("tests/live/agent/", "tests/live/client/", "e2e/tests/campaigns/"),
    "tests/support/claims/": ("tests/live/attacks/",),
    "tests/support/clients.py": ALL_OF_THE_REST,
    "tests/support/crds.py": ("tests/live/agent/", "tests/live/crds/"),
    "tests/support/factories.py": ("tests/live/operating/", "tests/live/journeys/"),
    "tests/support/largest.py": ("tests/live/operating/apps/test_largest_instance_live.py",),
    "tests/support/proxy/": (
        "tests/live/claims/",
        "tests/live/client/",
        "tests/live/crash/",
        "tests/live/faults/",
        "tests/live/journeys/",
        "tests/live/scheduling/",
        "e2e/tests/campaigns/",
    ),
    "tests/support/rigel/": ("tests/live/bridge/",),
    "tests/support/ros_sources.py": ("tests/live/bridge/",),
    "tests/support/scheduler/": ("tests/live/scheduling/", "tests/live/crds/", "e2e/tests/campaigns/"),
    "tests/support/scheduling.py": ("tests/live/scheduling/", "e2e/tests/campaigns/"),
    "tests/support/schemas.py": ("tests/live/crds/",),
    "tests/support/seeds.py": ALL_OF_THE_REST,
    "tests/support/virtual_time.py": ("e2e/tests/campaigns/",),
    "tests/support/work_unit.py": (
        "tests/live/attacks/",
        "tests/live/chart/",
        "tests/live/nodes/",
        "tests/live/operating/",
        "tests/live/reference/",
        "tests/live/scheduling/",
        "e2e/tests/live/switch/",
        "e2e/tests/testbed/",
    ),
    "tests/support/wrong_input/": ("tests/live/crds/", "tests/live/journeys/", "tests/live/scheduling/"),
}
"""Beginning of a source file's path → folders or modules of the rest that test it. All rows that match count."""


def find_test_folders(name: str) -> tuple[str, ...]:
    """Returns the folders and modules of tests that a changed file concerns; for a file of the tests, its own folder."""
    if name.startswith(("tests/live/", "e2e/tests/")):
        return (f"{_group_name(name.rpartition('/')[0])}/",)
    return tuple(folder for start, folders in TEST_FOLDERS.items() if name.startswith(start) for folder in folders)


def take_turn(groups: Sequence[Group], waiting: Sequence[str], count: int) -> tuple[list[Group], list[str]]:
    """Returns the groups whose turn it is, about one of `count` equal shares of all, and the names that still wait after it.

    `waiting` holds the names that have not run in this round, empty when a new one begins. A group that is new in the
    middle of a round waits for the next round: its own change makes it run at once.
    """
    by_name = {group.name: group for group in groups}
    names = [name for name in waiting if name in by_name] or list(by_name)
    share_s = sum(group.seconds for group in groups) / count
    turn: list[Group] = []
    while names and sum(group.seconds for group in turn) < share_s:
        turn.append(by_name[names.pop(0)])
    return turn, names


def _module_of(entry: str) -> str:
    return entry.partition("::")[0]


def _group_name(path: str) -> str:
    """Returns the folder whose tests share a process: tests/live/FOLDER, e2e/tests/live/FOLDER or e2e/tests/FOLDER."""
    parts = path.split("/")
    depth = 4 if path.startswith("e2e/tests/live/") else 3
    return "/".join(parts[:depth]).removesuffix(".py")
