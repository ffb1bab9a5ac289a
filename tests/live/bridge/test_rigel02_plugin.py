"""`rigel deploy` of the real Rigel 0.2.22 with our wheel beside it, as a user installs both."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration

from rigel_bridge.main import main

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = {path.parent.name: path.read_text() for path in (ROOT / "examples" / "rigel").glob("*/Rigelfile")}
NOETIC = ONE.replace("humble", "noetic")
SAMPLES = {
    **{name: text for name, text in EXAMPLES.items() if "\npackages:" in text},
    "two-packages": orchestration("{name: x, scheduler: {policies: {latency_budget: 30ms}}}", TWO),
    "ros1": orchestration("{name: x, deploy_ros_master: true}", NOETIC),
    "templates": "vars: {tag: '2'}\n" + orchestration("{name: 'app-{{ tag }}'}"),
}
BAD = {
    "value": (orchestration("{scheduler: {policies: {latency_budget: soon}}}"), 72, "latencyBudget"),
    "key": (orchestration("{schedular: {}}"), 72, "did you mean scheduler"),
    "distro": (orchestration("{name: x}", ONE.replace("humble", "humbel")), 72, "humble"),
}
# Rigel's commands one after the other in one process: to import Rigel takes longer than to run them.
ALL = """
import contextlib, io, json, os
from rigel.cli import cli
for folder in sorted(os.listdir(".")):
    os.chdir(folder)
    found = {}
    for command in ("create", "deploy"):
        shown, code = io.StringIO(), 0
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(shown):
            try:
                cli.main(args=[command], standalone_mode=False)
            except SystemExit as end:
                code = end.code or 0
        found[command] = [code, shown.getvalue()]
    with open("outcome.json", "w") as file:
        json.dump(found, file)
    os.chdir("..")
"""
pytestmark = pytest.mark.timeout(900)  # a package index may be far away


@pytest.fixture(scope="module")
def rigel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of an environment with Rigel and our wheel."""
    folder = tmp_path_factory.mktemp("rigel02") / "venv"
    uv = str(Path(sys.executable).parent / "uv")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    subprocess.run([uv, "venv", "--quiet", "--python", version, str(folder)], check=True)
    # setuptools 82 dropped pkg_resources, which Rigel imports without asking for it.
    wanted = ("rigel==0.2.22", "setuptools<82", str(ROOT))
    install = [uv, "pip", "install", "--quiet", "--python", str(folder), *wanted]
    subprocess.run(install, check=True, timeout=600)
    return folder / "bin"


def run(rigel: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONWARNINGS": "ignore", "COLUMNS": "300"}
    command = [rigel / "rigel", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_the_environment_is_consistent_and_has_rigels_pydantic(rigel: Path) -> None:
    uv = str(Path(sys.executable).parent / "uv")
    checked = subprocess.run(
        [uv, "pip", "check", "--python", rigel / "python"], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stderr
    shown = "import pydantic; print(pydantic.VERSION)"
    assert subprocess.check_output([rigel / "python", "-c", shown], text=True).startswith("1.")


@pytest.fixture(scope="module")
def outcomes(rigel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder per file, in which Rigel's own command functions ran; outcome.json has exit codes and output of each command."""
    folder = tmp_path_factory.mktemp("files")
    for name, text in {**SAMPLES, **{name: text for name, (text, _, _) in BAD.items()}}.items():
        (folder / name).mkdir()
        (folder / name / "Rigelfile").write_text(text)
    environment = {**os.environ, "PYTHONWARNINGS": "ignore", "COLUMNS": "300"}
    subprocess.run([rigel / "python", "-c", ALL], cwd=folder, env=environment, check=True, capture_output=True)
    return folder


def outcome(outcomes: Path, name: str, command: str) -> tuple[int, str]:
    code, told = json.loads((outcomes / name / "outcome.json").read_text())[command]
    return code, told


@pytest.mark.parametrize("sample", SAMPLES)
def test_rigel_creates_its_files_and_deploys_the_bytes_of_render(
    outcomes: Path, sample: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for command in ("create", "deploy"):
        code, told = outcome(outcomes, sample, command)
        assert code == 0, told
    (written,) = (outcomes / sample).glob("*.robotapp.yaml")
    monkeypatch.chdir(outcomes / sample)
    assert main(["render", "-o", "rendered.yaml"]) == 0
    assert written.read_bytes() == Path("rendered.yaml").read_bytes()


@pytest.mark.parametrize("kind", BAD)
def test_a_mistake_has_our_code_and_words(outcomes: Path, kind: str) -> None:
    _, wanted, words = BAD[kind]
    code, told = outcome(outcomes, kind, "deploy")
    assert code == wanted, told
    assert words in told
    assert "Traceback" not in told
    assert not list((outcomes / kind).glob("*.robotapp.yaml"))


def test_the_command_itself_ends_with_our_code_and_one_line(rigel: Path, tmp_path: Path) -> None:
    text, code, told = BAD["value"]
    (tmp_path / "Rigelfile").write_text(text)
    done = run(rigel, tmp_path, "deploy")
    assert done.returncode == code
    assert told in done.stdout
    assert "Traceback" not in done.stdout + done.stderr
