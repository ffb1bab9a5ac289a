"""`rigel deploy` of the real Rigel 0.2.22 with our wheel beside it, as a user installs both."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.rigelfiles import ONE, TWO, orchestration

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
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # a package index may be far away


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


@pytest.mark.parametrize("sample", SAMPLES)
def test_rigel_creates_its_files_and_deploys_the_bytes_of_render(
    rigel: Path, sample: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "Rigelfile").write_text(SAMPLES[sample])
    for command in ("create", "deploy"):
        done = run(rigel, tmp_path, command)
        assert done.returncode == 0, done.stdout + done.stderr
    (written,) = tmp_path.glob("*.robotapp.yaml")
    monkeypatch.chdir(tmp_path)
    assert main(["render", "-o", "rendered.yaml"]) == 0
    assert written.read_bytes() == Path("rendered.yaml").read_bytes()


@pytest.mark.parametrize("kind", ["value", "key", "distro"])
def test_a_mistake_ends_rigel_with_our_code_and_words(rigel: Path, kind: str, tmp_path: Path) -> None:
    text, code, told = BAD[kind]
    (tmp_path / "Rigelfile").write_text(text)
    done = run(rigel, tmp_path, "deploy")
    assert done.returncode == code
    assert told in done.stdout
    assert "Traceback" not in done.stdout + done.stderr
    assert not list(tmp_path.glob("*.robotapp.yaml"))
