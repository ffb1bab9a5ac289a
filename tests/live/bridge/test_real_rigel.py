"""Rigel 0.2.22 itself, from the package index, in an environment of its own: one file must please both programs."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.support.rigel.cases import ENVIRONMENT, first_generation
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration

from campaigns.bridge.rigelfiles import difference
from campaigns.bridge.rigelfiles import readings as readings_of
from rigel_bridge.document.tree import parse
from rigel_bridge.generations.load import load
from rigel_bridge.generations.model import Options

# setuptools 82 dropped pkg_resources, which Rigel imports without asking for it.
REQUIREMENTS = ("rigel==0.2.22", "setuptools<82")
EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "rigel" / "teleop" / "Rigelfile"
# Rigel's own reading of ./Rigelfile in every folder, as JSON.
READ = """
import json, os
from rigel.cli import parse_rigelfile
found = {}
for folder in sorted(os.listdir(".")):
    os.chdir(folder)
    found[folder] = json.loads(parse_rigelfile().json())["packages"]
    os.chdir("..")
print("JSON" + json.dumps(found))
"""
SAMPLES = {
    "example": EXAMPLE.read_text(),
    "smallest": ONE,
    "own-dockerfile": TWO,
    "templates": "vars: {a: one, tag: '2'}\n" + ONE.replace(":1", ":{{ a }}-{{tag}}-{{ vars.a }}-{{ FROM_ENV }}"),
    "orchestration": orchestration("{name: x, scheduler: {policies: {latency_budget: 30ms}}}", TWO),
    "command-with-quotes": ONE.replace("run base_driver driver", "'bash -c \"sleep 1\"'").replace(
        "ros2 'bash", "'bash"
    ),
}
pytestmark = pytest.mark.timeout(900)  # a package index may be far away


@pytest.fixture(scope="session")
def rigel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment that holds the real Rigel (108 MB; a few seconds from uv's cache)."""
    folder = tmp_path_factory.mktemp("rigel") / "venv"
    uv = str(Path(sys.executable).parent / "uv")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    subprocess.run([uv, "venv", "--quiet", "--python", version, str(folder)], check=True)
    python = folder / "bin" / "python"
    subprocess.run([uv, "pip", "install", "--quiet", "--python", str(python), *REQUIREMENTS], check=True, timeout=600)
    return python


@pytest.fixture(scope="session")
def readings(rigel: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, str]]]:
    """The packages of every sample as Rigel reads them."""
    folder = tmp_path_factory.mktemp("samples")
    for name, text in SAMPLES.items():
        (folder / name).mkdir()
        (folder / name / "Rigelfile").write_text(text)
    environment = {**os.environ, "FROM_ENV": "env"}
    result = subprocess.run(
        [rigel, "-W", "ignore", "-c", READ], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    found: dict[str, list[dict[str, str]]] = json.loads(result.stdout.rpartition("JSON")[2])
    return found


@pytest.mark.parametrize("sample", SAMPLES)
def test_rigel_reads_the_same_packages_from_the_same_file(
    readings: dict[str, list[dict[str, str]]], sample: str
) -> None:
    options = Options(environment={"FROM_ENV": "env"})
    ours = load(parse(SAMPLES[sample].encode(), "Rigelfile"), options).targets[0].packages
    assert [(p.name, p.image, p.distro, p.command) for p in ours] == [
        (p["package"], p["image"], p.get("distro"), p.get("command")) for p in readings[sample]
    ]


def test_made_files_are_read_alike_but_for_stated_reasons(rigel: Path, tmp_path: Path) -> None:
    seed = int(time.time())
    texts = [first_generation(seed + number) for number in range(200)]
    theirs = readings_of(rigel, tmp_path, texts, ENVIRONMENT)
    assert sum("packages" in one for one in theirs) > 50, (
        "most files must be ones that Rigel takes, or nothing is compared"
    )
    found = {
        seed + number: said
        for number, (text, one) in enumerate(zip(texts, theirs, strict=True))
        if (said := difference(text, one, ENVIRONMENT))
    }
    assert not found


def test_rigel_creates_its_docker_files_from_our_example(rigel: Path, tmp_path: Path) -> None:
    (tmp_path / "Rigelfile").write_text(SAMPLES["example"])
    result = subprocess.run(
        [rigel.parent / "rigel", "create"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert len(list(tmp_path.rglob("Dockerfile"))) == 2


def test_the_bridge_lives_in_rigels_environment_and_writes_the_same(rigel: Path, tmp_path: Path) -> None:
    (tmp_path / "Rigelfile").write_text(SAMPLES["example"])
    sources = [Path(__file__).resolve().parents[3] / name for name in ("rigel_bridge", "ros_profile")]
    outputs = []
    for python in (Path(sys.executable), rigel):
        command = [python, "-m", "rigel_bridge.main", "render"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, sources))}
        result = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        outputs.append([line for line in result.stdout.splitlines() if "bridge-version" not in line])
    assert outputs[0] == outputs[1]
