"""Images with Python, built twice: the same bytes, and the interpreter in them runs what it shall run."""

import json
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import pytest

from robotapp_testbed import images
from robotapp_testbed.failures import TestbedError

pytestmark = pytest.mark.live


def archive(name: str) -> Path:
    try:
        return images.archive(name)
    except TestbedError as reason:
        if "apt" not in str(reason):
            raise
        pytest.skip(str(reason))


def read(tar: tarfile.TarFile, digest: str) -> bytes:
    file = tar.extractfile(f"blobs/sha256/{digest.removeprefix('sha256:')}")
    assert file is not None
    return file.read()


def unpack(path: Path, target: Path) -> dict[str, Any]:
    """All layers into `target`; the image's configuration."""
    with tarfile.open(path) as tar:
        index = tar.extractfile("index.json")
        assert index is not None
        manifest = json.loads(read(tar, json.load(index)["manifests"][0]["digest"]))
        for layer in manifest["layers"]:
            command = ["tar", "--extract", "--keep-directory-symlink", "--no-same-owner", "--directory", target]
            subprocess.run(command, input=read(tar, layer["digest"]), check=True)
        config: dict[str, Any] = json.loads(read(tar, manifest["config"]["digest"]))["config"]
        return config


def python(root: Path, *arguments: str) -> str:
    """Run the image's interpreter through the image's own loader: needs no root and nothing of this machine."""
    (loader,) = (root / "usr").glob("lib*/ld-linux-*.so.*")
    (libraries,) = (root / "usr" / "lib").glob("*-linux-gnu")
    program = [loader, "--library-path", libraries, root / "usr" / "bin" / "python3"]
    env = {"PYTHONHOME": f"{root}/usr", "PYTHONPATH": f"{root}/opt/robotapp:{root}/usr/lib/python3/dist-packages"}
    result = subprocess.run([*program, *arguments], env=env, capture_output=True, text=True, check=True)
    return result.stdout


@pytest.mark.parametrize("name", ["operator", "ros2"])
def test_two_builds_give_the_same_bytes(name: str, tmp_path: Path) -> None:
    cached = archive(name)
    images.build(name, images.RECIPES[name](), tmp_path / "again.tar")
    assert (tmp_path / "again.tar").read_bytes() == cached.read_bytes()


def test_the_operators_image_starts_the_operator_and_holds_no_scheduler_dependencies(tmp_path: Path) -> None:
    config = unpack(archive("operator"), tmp_path)
    assert config["User"] == "65532:65532"
    assert "--sweep-seconds" in python(tmp_path, *config["Entrypoint"][1:], "--help")
    assert not (tmp_path / "opt" / "robotapp" / "numpy").exists()
    assert list((tmp_path / "opt" / "robotapp" / "robotapp_operator" / "__pycache__").glob("*.pyc"))


def test_the_ros_2_image_opens_a_dds_domain(tmp_path: Path) -> None:
    unpack(archive("ros2"), tmp_path)
    line = "import cyclonedds.domain as d; d.DomainParticipant(101); print('joined')"
    assert python(tmp_path, "-c", line) == "joined\n"


def test_a_name_that_is_no_image_is_refused() -> None:
    result = subprocess.run(["scripts/build", "images", "paws"], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert "no image 'paws'" in result.stderr
