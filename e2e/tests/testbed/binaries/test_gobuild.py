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


# `-o TARGET` are the arguments 6 and 7 of the command line.
WRITES = 'echo "net/http" >&2; echo "$GOFLAGS $CGO_ENABLED" >&2; printf program > "$7"'


def test_the_compiler_writes_the_target_and_its_lines_are_passed_on(tmp_path: Path) -> None:
    lines: list[str] = []
    build(fake_go(tmp_path, WRITES), tmp_path / "helm", lines)
    assert (tmp_path / "helm").read_text() == "program"
    assert lines == ["net/http", "-mod=readonly 0"]


def test_the_command_pins_flags_and_package() -> None:
    command = gobuild.command(Go(program=Path("/go/bin/go"), version="1.26"), HELM, Path("/cache/helm"))
    assert command[:4] == ["/go/bin/go", "build", "-v", "-trimpath"]
    assert command[-3:] == ["-o", "/cache/helm", "helm.sh/helm/v4/cmd/helm"]


def test_the_users_proxy_stays_and_what_changes_the_result_is_fixed() -> None:
    env = gobuild.build_environment(
        {"GOPROXY": "https://mine", "GOFLAGS": "-mod=vendor", "GOWORK": "/w", "PATH": "/bin"}
    )
    assert env["GOPROXY"] == "https://mine"
    assert (env["GOFLAGS"], env["GOWORK"], env["GOTOOLCHAIN"], env["CGO_ENABLED"]) == (
        "-mod=readonly",
        "off",
        "local",
        "0",
    )


def test_variables_of_the_users_own_cross_compiling_change_nothing() -> None:
    theirs = {"GOOS": "windows", "GOARCH": "riscv64", "GOAMD64": "v4", "GOARM64": "v9.0"}
    assert gobuild.build_environment(theirs) == gobuild.build_environment({})


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


def test_an_interrupt_ends_the_compiler(tmp_path: Path) -> None:
    go = fake_go(tmp_path, 'echo "$$" >&2; exec sleep 600')
    pids: list[str] = []

    def interrupt(line: str) -> None:
        pids.append(line)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gobuild.build(go, HELM, tmp_path / "helm", on_line=interrupt, module_dir=tmp_path)
    assert not Path(f"/proc/{pids[0]}").exists()


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
