"""Compiling, with a shell script in Go's place."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robotapp_testbed import TestbedError, wait_until
from robotapp_testbed.binaries import gobuild, pins
from robotapp_testbed.binaries.toolchain import Go

HELM = pins.binary("helm")


def fake_go(folder: Path, script: str) -> Go:
    program = folder / "go"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    return Go(program=program, version="1.26.0")


def build(go: Go, target: Path, lines: list[str] | None = None) -> None:
    found = lines if lines is not None else []
    gobuild.build(go, HELM, target, on_line=found.append, module_dir=target.parent)


@pytest.mark.parametrize(
    ("output", "advice"),
    [
        ("dial tcp: lookup proxy.example: no such host", "check the network and `go env GOPROXY`"),
        ("dial tcp: x509: certificate signed by unknown authority", "set SSL_CERT_FILE=/path/to/authorities.pem"),
        ("write /tmp/x: no space left on device", "free about 3 GB"),
        ("undefined: something", "run it again"),
    ],
)
def test_a_failure_ends_with_a_sentence_that_says_what_to_do(output: str, advice: str, tmp_path: Path) -> None:
    with pytest.raises(TestbedError) as caught:
        build(fake_go(tmp_path, f'echo "{output}" >&2; exit 1'), tmp_path / "helm")
    first, last = str(caught.value).splitlines()
    assert first == output
    assert last.startswith("helm could not be compiled: ")
    assert advice in last


def test_a_killed_caller_takes_the_compiler_along(tmp_path: Path) -> None:
    fake_go(tmp_path, f"echo $$ > {tmp_path}/pid; exec sleep 600")
    code = (
        "from pathlib import Path; from robotapp_testbed.binaries import gobuild, pins; from robotapp_testbed.binaries.toolchain import Go\n"
        f"folder = Path({str(tmp_path)!r})\n"
        "gobuild.build(Go(folder / 'go', '1'), pins.binary('helm'), folder / 'helm', on_line=print, module_dir=folder)"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as caller:
        pid_file = tmp_path / "pid"
        assert wait_until(lambda: pid_file.exists() and pid_file.read_text().endswith("\n"), timeout_s=60)
        os.kill(caller.pid, signal.SIGKILL)
        caller.wait()
    assert wait_until(lambda: not Path(f"/proc/{pid_file.read_text().strip()}").exists(), timeout_s=60)
