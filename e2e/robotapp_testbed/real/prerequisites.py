"""What a machine must have for real nodes, and the one sentence that says what is missing."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real.scripts import try_kernel

CNI_FOLDERS: Final = (Path("/usr/lib/cni"), Path("/opt/cni/bin"), Path("/usr/libexec/cni"))
_CNI_PLUGINS: Final = ("bridge", "host-local", "loopback")
_TRIED_S: Final = 20.0
_SYSTEM_PATH: Final = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


class UnavailableError(TestbedError):
    """This machine cannot run real nodes; the message says why and what to do."""

    def __init__(self, message: str, *, packages: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.packages = tuple(packages)


@dataclass(frozen=True, slots=True)
class Package:
    name: str
    """As Debian and Ubuntu call it."""
    is_there: Callable[[], bool]


def program(name: str) -> Path | None:
    """Absolute path; system folders count even where a user's PATH lacks them."""
    found = shutil.which(name, path=f"{os.environ.get('PATH', '')}:{_SYSTEM_PATH}")
    return Path(found) if found else None


def required_program(name: str) -> Path:
    path = program(name)
    if path is None:
        raise UnavailableError(f"{name} is not installed: see `python -m robotapp_testbed doctor`")
    return path


def cni_folder() -> Path | None:
    for folder in CNI_FOLDERS:
        if all((folder / plugin).is_file() for plugin in _CNI_PLUGINS):
            return folder
    return None


PACKAGES: Final = (
    Package("containerd", lambda: all(map(program, ("containerd", "ctr", "containerd-shim-runc-v2")))),
    Package("runc", lambda: program("runc") is not None),
    Package("containernetworking-plugins", lambda: cni_folder() is not None),
    Package("iptables", lambda: all(map(program, ("iptables", "iptables-save", "iptables-restore")))),
    Package("busybox-static", lambda: program("busybox") is not None),
    Package("iproute2", lambda: program("ip") is not None),
    Package("util-linux", lambda: program("nsenter") is not None),
)


def missing_packages(packages: Sequence[Package] = PACKAGES) -> list[str]:
    return [package.name for package in packages if not package.is_there()]


def missing(
    *,
    uid: int | None = None,
    packages: Sequence[Package] = PACKAGES,
    kernel: Callable[[], str] | None = None,
) -> UnavailableError | None:
    """The first thing that is missing: the system, root, packages (all of them), a feature of the kernel."""
    if sys.platform != "linux":
        return UnavailableError(f"real nodes need Linux, this is {sys.platform}: use a Linux machine")
    if (os.geteuid() if uid is None else uid) != 0:
        return UnavailableError(
            "real nodes need root (namespaces, mounts, cgroups): run the command with sudo, or use kwok nodes"
        )
    absent = missing_packages(packages)
    if absent:
        line = f"apt-get install --no-install-recommends {' '.join(absent)}"
        return UnavailableError(f"real nodes need {', '.join(absent)}: {line}", packages=absent)
    refused = (kernel or kernel_refuses)()
    return UnavailableError(f"real nodes cannot run here: {refused}") if refused else None


def require() -> None:
    """UnavailableError unless everything is there."""
    problem = missing()
    if problem:
        raise problem


def kernel_refuses() -> str:
    """Empty when the kernel does all that is needed, else which thing it refused and why. Tried, not looked up (50 ms)."""
    with tempfile.TemporaryDirectory(prefix="robotapp-try-") as folder:
        done = subprocess.run(
            [sys.executable, "-I", "-S", try_kernel.__file__, folder],
            capture_output=True,
            text=True,
            timeout=_TRIED_S,
            check=False,
        )
    lines = (done.stdout.strip() or done.stderr.strip()).splitlines()
    return "" if done.returncode == 0 else (lines[-1] if lines else f"the trial ended with {done.returncode}")


def may_lower_oom_score() -> bool:
    """CAP_SYS_RESOURCE: without it runc must not set the scores kubelets ask for."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) & 1 << 24)
    return False


def bridged_traffic_is_filtered() -> bool:
    return Path("/proc/sys/net/bridge/bridge-nf-call-iptables").exists()
