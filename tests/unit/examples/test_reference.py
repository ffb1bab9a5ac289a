"""The applications of examples/reference: their Rigelfile, RobotApp, compose file, parameters and README agree with one another."""

import contextlib
import io
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from journeys import graphs
from rigel_bridge.main import main as bridge
from robotapp_cli.lint.linter import lint
from robotapp_cli.main import app as cli
from robotapp_testbed import images
from ros_profile.generate import generate_profile
from ros_profile.main import main as profile

FOLDER = Path(__file__).parents[3] / "examples" / "reference"
APPS = sorted(path for path in FOLDER.iterdir() if path.is_dir())
RIGELFILES = ("Rigelfile", "rigel-0.3/Rigelfile")
"""In the form of Rigel 0.2 and in that of 0.3; the RobotApp is rendered from the first."""
FILES = ("Dockerfile", "README.md", *RIGELFILES, "compose.yaml", "robotapp.yaml")


@pytest.fixture(params=APPS, ids=lambda path: path.name)
def app(request: pytest.FixtureRequest) -> Path:
    folder: Path = request.param
    return folder


def render(rigelfile: Path, *flags: str) -> str:
    """Returns what rigel-bridge makes of the Rigelfile."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        assert bridge(["render", str(rigelfile), *flags]) == 0
    return output.getvalue()


def read_package(app: Path) -> Path:
    (package,) = (path for path in (app / "src").iterdir() if path.is_dir())
    return package


def words_of(component: dict[str, Any]) -> tuple[str, str, list[str]]:
    """Returns name, image and command line of a component."""
    return component["name"], component["image"], component["args"]


def test_each_application_is_listed_and_can_be_built_by_the_testbed() -> None:
    listed = (FOLDER / "README.md").read_text()
    assert [app.name for app in APPS if f"]({app.name}/README.md)" not in listed] == []
    assert [app.name for app in APPS if app.name not in images.RECIPES] == []


def test_an_application_has_its_files_and_one_package(app: Path) -> None:
    assert [name for name in FILES if not (app / name).is_file()] == []
    package = read_package(app)
    assert (package / "package.xml").is_file()
    assert list((package / "launch").iterdir())


def test_the_rigelfile_renders_to_the_robotapp(app: Path) -> None:
    assert render(app / "Rigelfile") == (app / "robotapp.yaml").read_text()


def test_the_rigelfile_of_rigel_0_3_renders_to_the_same_app(app: Path) -> None:
    rendered = yaml.safe_load(render(app / "rigel-0.3" / "Rigelfile"))
    committed = yaml.safe_load((app / "robotapp.yaml").read_text())
    assert rendered["metadata"]["annotations"]["rigel.robotics.io/generation"] == "g3"
    assert rendered["metadata"]["name"] == committed["metadata"]["name"]
    assert rendered["spec"] == committed["spec"]


@pytest.mark.parametrize("rigelfile", RIGELFILES)
def test_neither_rigelfile_has_a_mistake_in_any_job_or_sequence(app: Path, rigelfile: str) -> None:
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        assert bridge(["check", str(app / rigelfile)]) == 0
    assert "error" not in output.getvalue()


@pytest.mark.parametrize("rigelfile", RIGELFILES)
@pytest.mark.parametrize(
    ("sequence", "scheduler", "has_wishes"),
    [
        ("demo", "ros-aware-scheduler", True),
        ("benchmark_default", "default-scheduler", False),
        ("benchmark_custom", "ros-aware-scheduler", True),
    ],
)
def test_three_sequences_choose_the_scheduler_and_nothing_else_of_the_programs(
    app: Path, rigelfile: str, sequence: str, scheduler: str, has_wishes: bool
) -> None:
    spec = yaml.safe_load(render(app / rigelfile, "--sequence", sequence))["spec"]
    committed = yaml.safe_load((app / "robotapp.yaml").read_text())["spec"]
    assert spec["schedulerName"] == scheduler
    assert any("policies" in component for component in spec["components"]) is has_wishes
    assert list(map(words_of, spec["components"])) == list(map(words_of, committed["components"]))


def test_the_robotapp_has_no_findings_of_lint(app: Path) -> None:
    assert lint((app / "robotapp.yaml").read_bytes()).findings == []


def test_the_compose_file_imports_to_the_same_app(app: Path) -> None:
    result = CliRunner().invoke(cli, ["import", str(app / "compose.yaml")])
    assert result.exit_code == 0, result.output
    *claims, imported = yaml.safe_load_all(result.stdout)
    committed = yaml.safe_load((app / "robotapp.yaml").read_text())
    assert imported["metadata"]["name"] == committed["metadata"]["name"]
    assert imported["spec"] == committed["spec"]
    assert lint(result.stdout.encode()).findings == []
    files = [yaml.safe_load(path.read_text()) for path in app.glob("claim.yaml")]
    assert [claim["metadata"]["name"] for claim in claims] == [claim["metadata"]["name"] for claim in files]


def test_the_picture_of_the_readme_shows_the_app_as_it_is_now_and_says_what_it_is(app: Path) -> None:
    """`scripts/screenshots --graphs` draws it anew."""
    picture = (app / graphs.PICTURE).read_text()
    spec = yaml.safe_load((app / "robotapp.yaml").read_text())["spec"]
    (facts,) = re.findall(r"<metadata>(.*?)</metadata>", picture)
    assert json.loads(facts)["spec"] == graphs.hash_spec(app)
    assert graphs.read_styles() in picture
    shown = [*(f">{component['name']}</text>" for component in spec["components"])]
    shown += [f"{edge['topic']}, {edge['from']} → {edge['to']}: " for edge in spec["edges"]]
    assert [words for words in shown if words not in picture] == []
    assert f"![{app.name} in the console: " in (app / "README.md").read_text()
    assert f"({graphs.PICTURE})" in (app / "README.md").read_text()


def test_a_parameter_of_the_files_is_one_that_a_node_declares_or_gets(app: Path) -> None:
    package = read_package(app)
    sources = "".join(
        path.read_text() for path in package.rglob("*") if path.suffix in (".py", ".cpp") or path.parent.name == "nodes"
    )
    names = {name for path in (package / "config").glob("*.yaml") for name in list_parameters(path)}
    assert names
    assert sorted(name for name in names if f'"{name}"' not in sources and f'"~{name}"' not in sources) == []


def list_parameters(path: Path) -> set[str]:
    """Returns none for a file that is not of parameters, such as a world."""
    nodes = [node for node in yaml.safe_load(path.read_text()).values() if isinstance(node, dict)]
    if path.parents[2].parent.name.endswith("ros2"):
        return {name for node in nodes for name in node.get("ros__parameters", {})}
    return {name for node in nodes for name in node}


def test_the_readme_has_what_the_profile_generator_makes_of_the_package(app: Path) -> None:
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        assert profile([str(app / "src"), "--no-cache"]) == 0
    assert output.getvalue().strip() in (app / "README.md").read_text()


def test_each_component_has_the_class_that_the_profile_generator_infers_for_its_program(app: Path) -> None:
    (package,) = generate_profile(app / "src").packages
    inferred = {
        executable.name: executable.assessment.qos_class.value
        for executable in package.executables
        if executable.assessment.qos_class
    }
    components = yaml.safe_load((app / "robotapp.yaml").read_text())["spec"]["components"]
    programs = {component["name"]: Path(component["args"][3]).stem for component in components}
    stated = {component["name"]: component.get("qosClass") for component in components}
    assert stated == {name: inferred[program] for name, program in programs.items()}


def test_what_the_robotapp_starts_is_part_of_the_package(app: Path) -> None:
    package = read_package(app)
    for component in yaml.safe_load((app / "robotapp.yaml").read_text())["spec"]["components"]:
        match component["args"]:
            case ["ros2", "run", package.name, executable, *_]:
                assert f'"{executable} = ' in (package / "setup.py").read_text()
            case ["roslaunch", "--wait", package.name, launch_file, *_]:
                assert (package / "launch" / launch_file).is_file()
            case words:
                pytest.fail(f"unknown way to start: {shlex.join(words)}")


@pytest.mark.parametrize(
    "pattern",
    [
        "fleet-*/src/**/tasks.py",
        "detection-*/src/**/detector.py",
        "detection-*/src/**/scene.py",
    ],
)
def test_both_generations_of_an_application_share_what_has_nothing_of_ros(pattern: str) -> None:
    """Each folder is whole, as a repository of its own would be, so the file is there twice."""
    first, second = sorted(FOLDER.glob(pattern))
    assert first.read_text() == second.read_text()
