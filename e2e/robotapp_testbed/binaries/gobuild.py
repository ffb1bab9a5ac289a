"""Compile one binary of the control plane from its Go modules (e2e/controlplane/go.mod pins every version)."""

import os
import signal
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from robotapp_testbed.binaries import pins
from robotapp_testbed.binaries.toolchain import Go
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes.process import launcher

_ERROR_LINES = 6


def build_environment(env: Mapping[str, str]) -> dict[str, str]:
    """The user's module proxy and caches stay; what would change the result is fixed."""
    return {**env, **pins.go_environment()}


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
