"""The next version of the product: its wheel, built from our sources with a higher version and other templates."""

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import yaml

from robotapp_testbed.binaries.pins import REPOSITORY

LATER = "laterField"
"""What the next version's CRDs add to a component and elsewhere."""
_PACKAGES = ("crds", "client", "claims", "operator", "scheduler", "cli", "rigel_bridge")
_FILES = ("pyproject.toml", "README.md", "LICENSE")
_TEMPLATE = Path("operator/robotapp_operator/plan/render/pod_template.py")
_RENDERED, _RENDERED_NEWER = '"enableServiceLinks": False', '"enableServiceLinks": True'


def next_version() -> str:
    """The version after ours: its minor number is one higher."""
    text = (REPOSITORY / "pyproject.toml").read_text()
    major, minor, _ = _version(text).split(".")
    return f"{major}.{int(minor) + 1}.0"


def unpacked(folder: Path) -> Path:
    """A folder for PYTHONPATH, with the next version's wheel unpacked. Its operator renders service links into every pod."""
    sources = folder / "sources"
    sources.mkdir()
    for name in _PACKAGES:
        shutil.copytree(REPOSITORY / name, sources / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in _FILES:
        shutil.copy(REPOSITORY / name, sources)
    _replace(
        sources / "pyproject.toml",
        f'version = "{_version((sources / "pyproject.toml").read_text())}"',
        f'version = "{next_version()}"',
    )
    _replace(sources / _TEMPLATE, _RENDERED, _RENDERED_NEWER)
    uv = Path(sys.executable).with_name("uv")
    subprocess.run([uv, "build", "--quiet", "--wheel", "--out-dir", folder / "dist"], cwd=sources, check=True)
    (wheel,) = (folder / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "installed")
    return folder / "installed"


def crds(*, newer: bool) -> list[dict[str, Any]]:
    """The chart's CRDs as they are, or with fields that the next version adds: written by users, by default, and in the status."""
    found: list[dict[str, Any]] = [
        yaml.safe_load(path.read_text()) for path in sorted((REPOSITORY / "crds").glob("*.yaml"))
    ]
    for crd in found if newer else ():
        for version in crd["spec"]["versions"]:
            _add_fields(version["schema"]["openAPIV3Schema"]["properties"])
    return found


def _add_fields(properties: dict[str, Any]) -> None:
    for part in {"spec", "status"} & properties.keys():
        fields = properties[part].get("properties")
        if fields is None:
            continue
        fields["later"] = {"type": "object", "default": {}, "properties": {LATER: {"type": "string", "default": "x"}}}
        if "components" in fields and part == "spec":
            fields["components"]["items"]["properties"][LATER] = {"type": "string", "default": "x"}


def _version(pyproject: str) -> str:
    found = re.search(r'^version = "([^"]+)"$', pyproject, re.MULTILINE)
    assert found is not None
    return found[1]


def _replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1, f"{path} has {old!r} {text.count(old)} times"
    path.write_text(text.replace(old, new))
