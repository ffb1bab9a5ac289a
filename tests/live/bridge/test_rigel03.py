"""`rigel_bridge.RobotAppPlugin` in Rigel 0.3: in the contract double, and in a real checkout that RIGEL03_SRC names."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from rigel_bridge.main import main

ROOT = Path(__file__).resolve().parents[3]
CHECKOUT = os.environ.get("RIGEL03_SRC", "")
RIGELFILE = """\
vars: {image: acme/detector, tag: "2.1"}
application: {distro: humble}
jobs:
  deploy:
    plugin: rigel_bridge.RobotAppPlugin
    with:
      name: detector
      image: "{{ vars.image }}:{{ vars.tag }}"
      orchestration:
        scheduler: {policies: {latency_budget: 80ms}}
  another:
    plugin: rigel_bridge.RobotAppPlugin
    with: {name: another, image: acme/other:1, orchestration: {}}
  read:
    plugin: reading.Reader
    with: {text: "{{ data.robotapp_name }} {{ data.robotapp_file }}"}
sequences:
  demo: {stages: [{jobs: [deploy, read]}]}
  beside: {stages: [{jobs: [{name: read, with: {text: hello}}], dependencies: [deploy]}]}
  benchmark_default: {stages: [{jobs: [{name: deploy, with: {scheduler_name: default-scheduler, output: out/b.yaml}}]}]}
"""
READER = """\
from rigel.plugins import Plugin
class Reader(Plugin):
    def process(self):
        open("read.txt", "w").write(self.raw_data["text"])
"""


@dataclass(frozen=True)
class Rigel:
    """A way to call Rigel in a folder with our Rigelfile."""

    command: tuple[str, ...]
    path: str
    folder: Path

    def run(self, kind: str, name: str) -> subprocess.CompletedProcess[str]:
        """With the folder on the path, where the test's own plugin is."""
        environment = {**os.environ, "PYTHONPATH": f"{self.path}:{self.folder}", "PYTHONWARNINGS": "ignore"}
        command = [*self.command, "run", kind, name]
        return subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False, timeout=120
        )

    def app(self, name: str) -> dict[str, object]:
        found: dict[str, object] = yaml.safe_load((self.folder / name).read_text())
        return found


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the true Rigel 0.3 and our wheel."""
    folder = tmp_path_factory.mktemp("rigel03") / "venv"
    uv = str(Path(sys.executable).parent / "uv")
    subprocess.run([uv, "venv", "--quiet", "--python", "3.11", str(folder)], check=True)
    wanted = (CHECKOUT, "setuptools<82", str(ROOT))
    subprocess.run([uv, "pip", "install", "--quiet", "--python", folder / "bin" / "python", *wanted], check=True)
    return folder


@pytest.fixture(
    params=[
        "double",
        pytest.param("real", marks=pytest.mark.skipif(not CHECKOUT, reason="RIGEL03_SRC names no checkout")),
    ]
)
def rigel(request: pytest.FixtureRequest, tmp_path: Path) -> Rigel:
    (tmp_path / "Rigelfile").write_text(RIGELFILE)
    (tmp_path / "reading.py").write_text(READER)
    if request.param == "double":
        path = f"{ROOT / 'tests' / 'live' / 'bridge' / 'rigel03'}:{ROOT / 'rigel_bridge'}"
        return Rigel((sys.executable, "-m", "rigel"), path, tmp_path)
    return Rigel((str(request.getfixturevalue("checkout") / "bin" / "rigel"),), "", tmp_path)


def test_a_job_writes_what_render_writes(rigel: Rigel, monkeypatch: pytest.MonkeyPatch) -> None:
    done = rigel.run("job", "deploy")
    assert done.returncode == 0, done.stderr
    monkeypatch.chdir(rigel.folder)
    assert main(["render", "--job", "deploy", "-o", "rendered.yaml"]) == 0
    mine, rendered = rigel.app("detector.robotapp.yaml"), rigel.app("rendered.yaml")
    assert mine == rendered


def test_later_jobs_see_the_name_and_the_file_of_the_app(rigel: Rigel) -> None:
    done = rigel.run("sequence", "demo")
    assert done.returncode == 0, done.stderr
    assert (rigel.folder / "read.txt").read_text() == "detector detector.robotapp.yaml"


def test_an_app_that_others_depend_on_is_there_before_they_start_and_stays(rigel: Rigel) -> None:
    done = rigel.run("sequence", "beside")
    assert done.returncode == 0, done.stderr
    assert (rigel.folder / "read.txt").read_text() == "hello"
    assert (rigel.folder / "detector.robotapp.yaml").exists()


def test_an_override_of_a_sequence_reaches_the_app(rigel: Rigel) -> None:
    done = rigel.run("sequence", "benchmark_default")
    assert done.returncode == 0, done.stderr
    spec = rigel.app("out/b.yaml")["spec"]
    assert isinstance(spec, dict)
    assert spec["schedulerName"] == "default-scheduler"
    assert spec["components"][0]["image"] == "acme/detector:2.1"
    assert "policies" not in spec["components"][0], "a benchmark of the default scheduler has no wishes"


def test_of_two_jobs_the_one_that_runs_is_rendered(rigel: Rigel) -> None:
    assert rigel.run("job", "another").returncode == 0
    assert rigel.app("another.robotapp.yaml")["metadata"]["name"] == "another"  # type: ignore[index]


@pytest.mark.parametrize("name", ["teleop-ros2", "fleet-ros1"])
def test_a_file_with_several_components_gives_the_committed_app(rigel: Rigel, name: str) -> None:
    example = ROOT / "examples" / "reference" / name
    (rigel.folder / "Rigelfile").write_text((example / "rigel-0.3" / "Rigelfile").read_text())
    done = rigel.run("job", "deploy")
    assert done.returncode == 0, done.stderr
    committed = yaml.safe_load((example / "robotapp.yaml").read_text())
    assert rigel.app(f"{name}.robotapp.yaml")["spec"] == committed["spec"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("{policies: {latency_budget: soon}}", "Rigelfile:10: "),
        ("{polices: {}}", "did you mean policies"),
        ("{policies: {latency_budget: '{}'}}", "latencyBudget"),
    ],
)
def test_a_mistake_is_one_line_with_its_place_and_status_1(rigel: Rigel, wrong: str, told: str) -> None:
    text = RIGELFILE.replace("{policies: {latency_budget: 80ms}}", wrong)
    (rigel.folder / "Rigelfile").write_text(text)
    done = rigel.run("job", "deploy")
    assert done.returncode == 1
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(rigel.folder.glob("*.robotapp.yaml"))
