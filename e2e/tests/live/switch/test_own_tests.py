"""The Go tests of the switch's pure parts."""

import os
import subprocess

import pytest

from robotapp_testbed.binaries import pins, programs, toolchain
from robotapp_testbed.binaries.gobuild import build_environment

pytestmark = pytest.mark.live


def test_the_go_tests_of_the_switch_pass() -> None:
    programs.build("latency-switch")  # fetches its one module
    go = toolchain.find() or toolchain.install_wheel(print)
    folder = pins.REPOSITORY / "e2e" / programs.FOLDERS["latency-switch"]
    result = subprocess.run(
        [go.program, "test", "./..."],
        cwd=folder,
        env=build_environment(os.environ),
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
