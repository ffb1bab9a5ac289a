"""containerd's configuration. Pure."""

from pathlib import Path
from typing import Final

SOCKET: Final = "/run/containerd/containerd.sock"
PAUSE_IMAGE: Final = "localhost/robotapp-pause:testbed"
_UNUSED = ("aufs", "btrfs", "devmapper", "zfs", "native")

_CRI = "io.containerd.grpc.v1.cri"


def configuration(*, root: Path, cni_bin: Path, cni_conf: Path, privileged_oom: bool) -> str:
    """`root` keeps images and containers; `privileged_oom` says whether runc may lower oom_score_adj (CAP_SYS_RESOURCE).

    What containers may do without privileges is as from containerd 2.0 on.
    """
    unused = ", ".join(f'"io.containerd.snapshotter.v1.{name}"' for name in _UNUSED)
    return f"""\
version = 2
root = "{root}"
state = "/run/containerd"
disabled_plugins = [{unused}, "io.containerd.internal.v1.tracing", "io.containerd.tracing.processor.v1.otlp"]

[grpc]
  address = "{SOCKET}"

[plugins."io.containerd.internal.v1.opt"]
  path = "{root}/opt"

[plugins."{_CRI}"]
  sandbox_image = "{PAUSE_IMAGE}"
  enable_selinux = false
  enable_unprivileged_icmp = true
  enable_unprivileged_ports = true
  restrict_oom_score_adj = {"false" if privileged_oom else "true"}
  [plugins."{_CRI}".containerd]
    snapshotter = "overlayfs"
    [plugins."{_CRI}".containerd.runtimes.runc]
      runtime_type = "io.containerd.runc.v2"
      [plugins."{_CRI}".containerd.runtimes.runc.options]
        SystemdCgroup = false
  [plugins."{_CRI}".cni]
    bin_dir = "{cni_bin}"
    conf_dir = "{cni_conf}"
"""
