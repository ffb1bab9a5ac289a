"""What the pages name is there: files, tests, verbs of scripts/bench, values of the chart, variables of a container."""

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest
import yaml
from tests.support.factories import component, make_app

from campaigns.claims import claims_weakened
from robotapp_agent.report.status import SECTIONS
from robotapp_api.values.devices.words import AGENT_TYPES
from robotapp_operator import settings
from robotapp_operator.plan.render.parameters import ParameterState
from robotapp_operator.plan.render.pod_template import environment
from robotapp_operator.plan.spec.desired import Domain, desired_of
from robotapp_scheduler.config import flags as options

ROOT: Final = Path(__file__).resolve().parents[3]
FOLDERS: Final = tuple(path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith("."))
PAGES: Final = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.md")])
NOT_OURS: Final = {"docs/design/NNN-title.md", "mylab/quiet.py", "spawn_entity.py", "bringup/robot.launch.py"}
"""A pattern of names, a file of the reader's, and a program of ROS."""


@cache
def files() -> frozenset[str]:
    """Every path of the repository, and each of its ends: pages name some files without their first folders."""
    found = set(FOLDERS) | {path.name for path in ROOT.iterdir()}
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            parts = path.relative_to(ROOT).parts
            found |= {"/".join(parts[at:]) for at in range(len(parts))}
    return frozenset(found)


def without_blocks(page: Path) -> str:
    return re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def named_files(text: str) -> Iterator[str]:
    """What stands between backquotes and is written like a path of ours; not patterns (`*`, `<name>`, `{a,b}`, `…`)."""
    for code in re.findall(r"`([^`\n]+)`", text):
        for word in code.split():
            path = re.sub(r"(::.*|:\d+)$", "", word.strip(",;:()")).rstrip("/")
            ours = "/" in path and path.split("/")[0] in FOLDERS
            if re.fullmatch(r"[\w./-]+", path) and (ours or path.endswith(".py")):
                yield path


def headings(page: Path) -> set[str]:
    """As GitHub makes anchors of them."""
    lines = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).strip().replace(" ", "-") for line in lines}


def first_column(page: str, heading: str) -> list[str]:
    """The code in the first cell of each row of the table under a heading."""
    section = (ROOT / "docs" / page).read_text(encoding="utf-8").partition(heading)[2]
    table = re.search(r"(?:^\|.*\n)+", section, re.MULTILINE)
    rows = table.group().splitlines()[2:] if table else []
    return [code for row in rows for code in re.findall(r"`([^`]+)`", re.split(r"(?<!\\)\|", row)[1])]


def test_every_file_and_test_that_a_page_names_is_there() -> None:
    named = {(page.name, path) for page in PAGES for path in named_files(without_blocks(page))}
    assert len(named) > 100
    assert {(page, path) for page, path in named if path not in files() | NOT_OURS} == set()


def test_every_link_of_a_page_leads_somewhere() -> None:
    wrong = []
    for page in PAGES:
        for path, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", without_blocks(page)):
            target = page.parent / path if path else page
            if not target.exists() or (anchor and anchor not in headings(target)):
                wrong.append((page.name, path, anchor))
    assert wrong == []


def test_every_campaign_that_a_page_names_can_be_run() -> None:
    verbs = {verb for page in PAGES for verb in re.findall(r"scripts/bench ([a-z]\w*)", page.read_text())}
    assert len(verbs) > 20
    assert verbs <= {path.stem for path in (ROOT / "e2e/campaigns").glob("*/*.py") if "\ndef main(" in path.read_text()}


def test_the_table_of_bugs_that_were_put_in_is_the_one_that_is_run() -> None:
    rows = re.findall(r"^\| [^|]+ \| `(\w+)` \| ", (ROOT / "docs/claims.md").read_text(), re.MULTILINE)
    assert rows == list(claims_weakened.ALL)


def test_every_value_that_the_page_of_the_installation_explains_is_one_of_the_chart() -> None:
    chart = yaml.safe_load((ROOT / "helm/robotapp/values.yaml").read_text())
    explained = [code.partition(":")[0] for code in first_column("installation.md", "# Installing with Helm")]
    assert len(explained) >= 20
    for value in explained:
        found: Any = chart
        for key in value.removesuffix(".*").split("."):
            assert key in found or value == "name", value
            found = found.get(key)


@pytest.mark.parametrize(("page", "parse"), [("operator.md", settings.parse), ("scheduler.md", options.parse)])
def test_the_table_of_flags_is_that_of_the_program(
    page: str, parse: Callable[[list[str], dict[str, str]], object], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        parse(["--help"], {})
    flags = set(re.findall(r"^ +(?:-\w, )?(--[a-z-]+)", capsys.readouterr().out, re.MULTILINE)) - {"--help"}
    assert {flag.split()[0] for flag in first_column(page, "# ") if flag.startswith("--")} == flags


def test_the_pages_of_devices_and_agent_list_what_the_agent_reports() -> None:
    assert set(first_column("devices.md", "## Types")) == set(AGENT_TYPES)
    reported = {code.partition(".")[0] for code in first_column("agent.md", "## What is reported")}
    assert reported == SECTIONS - {"intervalSeconds", "seq"}


APPS: Final[Mapping[str, Mapping[str, Any]]] = {
    "Fast DDS": {"ros2": {"transport": "UDP"}},
    "Fast DDS before Iron": {"ros": {"distro": "humble"}},
    "Fast DDS since Iron": {"ros": {"distro": "jazzy"}},
    "Fast DDS with peers": {"ros2": {"discovery": {"mode": "Peers"}}},
    "Cyclone": {"ros2": {"rmw": "rmw_cyclonedds_cpp"}},
    "Connext": {"ros2": {"rmw": "rmw_connextdds"}},
    "Zenoh": {"ros2": {"rmw": "rmw_zenoh_cpp"}},
    "ROS 1": {"ros": {"distro": "noetic"}},
}


def test_the_page_of_the_environment_lists_every_variable_that_the_operator_sets() -> None:
    parts = (
        component("arm", devices=[{"name": "can", "type": "can"}], parameters=[{"inline": "{}"}]),
        component("base"),
        component("copy", replicaIdentity="Ordinal"),
        component("store", ros="None", parameters=[{"inline": "listener 1883"}]),
    )
    found = set()
    for spec in APPS.values():
        app = make_app(*parts, **spec)
        for part in app.spec.components:
            domain = Domain(7) if app.ros_version == 2 else None
            variables = environment(part, desired_of(app, "amr-07"), domain=domain, state=ParameterState(hash="0"))
            found |= {variable["name"] for variable in variables}
    listed = first_column("environment.md", "# Environment variables")
    assert set(listed) - {"ROBOTAPP_DEVICE_<NAME>", "MATRIX_<NAME>", "<name>"} == found
