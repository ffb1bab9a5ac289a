"""What somebody sees whose live test fails."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from robotapp_testbed.binaries.assets import Assets

pytestmark = pytest.mark.live

TESTS = """
def test_fails(control_plane, namespace):
    assert namespace == "something else"

def test_marked(request, control_plane):
    assert request.node.get_closest_marker("live")
"""


def test_a_failed_live_test_says_where_the_logs_are_and_keeps_them(tmp_path: Path) -> None:
    (tmp_path / "test_live.py").write_text(TESTS)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = live: real control plane\n")
    folder = next(iter(Assets().resolve(["etcd"]).values())).parent
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "ROBOTAPP_ASSETS": str(folder)}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "robotapp_testbed.pytest_plugin",
        "-p",
        "no:randomly",
        str(tmp_path),
    ]
    result = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False, timeout=200)
    assert "1 failed, 1 passed" in result.stdout, result.stdout + result.stderr
    match = re.search(r"^(\S+) now, (\S+) after the session$", result.stdout, re.MULTILINE)
    assert match, result.stdout
    assert not Path(match[1]).exists()
    kept = {path.name for path in Path(match[2]).iterdir()}
    assert {"etcd.log", "kube-apiserver.log", "kube-controller-manager.log", "kwok.log", "audit.jsonl"} <= kept
