"""The fields of a pod that Pod Security `baseline` forbids: where they stand, which values stay free, and the right they take.

The one source of the chart's policy, of the operator's check and of the matrix in docs/security.md. A live test compares it with
the Pod Security of the API server.
"""

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final

GROUP: Final = "robotics.io"
VERB: Final = "use"
APPARMOR_PREFIX: Final = "container.apparmor.security.beta.kubernetes.io/"
"""Annotations that older clusters read in place of `appArmorProfile`; the rest of the key is a container's name."""
FREE_APPARMOR: Final = ("", "runtime/default")
FREE_APPARMOR_PREFIX: Final = "localhost/"


class HostRight(StrEnum):
    """Virtual subresources of robotapps. Who holds the verb `use` on one may write the fields that take it."""

    NETWORK = "hostnetwork"
    IPC = "hostipc"
    PID = "hostpid"
    PATH = "hostpath"
    PRIVILEGED = "privileged"

    @property
    def resource(self) -> str:
        """The resource as a role names it."""
        return f"robotapps/{self.value}"


class Level(Enum):
    """The object that has a guarded field."""

    POD = "pod"
    CONTAINER = "container"
    ANNOTATIONS = "annotations"


@dataclass(frozen=True, slots=True)
class GuardedField:
    """`path`: below the pod's spec or the container; `[]` means every item of a list. `effect` continues "component driver …"."""

    path: str
    right: HostRight
    level: Level
    effect: str
    free: tuple[str | int | bool, ...] = ()
    """Values that every writer may use; without any, the field's presence counts."""

    @property
    def name(self) -> str:
        """The path as messages and pages show it."""
        return self.path.replace("[]", "")


_CAPABILITIES: Final = (
    "AUDIT_WRITE", "CHOWN", "DAC_OVERRIDE", "FOWNER", "FSETID", "KILL", "MKNOD", "NET_BIND_SERVICE", "SETFCAP", "SETGID",
    "SETPCAP", "SETUID", "SYS_CHROOT",
)  # fmt: skip
_SYSCTLS: Final = (
    "kernel.shm_rmid_forced", "net.ipv4.ip_local_port_range", "net.ipv4.ip_local_reserved_ports", "net.ipv4.ip_unprivileged_port_start",
    "net.ipv4.ping_group_range", "net.ipv4.tcp_fin_timeout", "net.ipv4.tcp_keepalive_intvl", "net.ipv4.tcp_keepalive_probes",
    "net.ipv4.tcp_keepalive_time", "net.ipv4.tcp_notsent_lowat", "net.ipv4.tcp_rmem", "net.ipv4.tcp_slow_start_after_idle",
    "net.ipv4.tcp_syncookies", "net.ipv4.tcp_wmem",
)  # fmt: skip
_SELINUX_TYPES: Final = ("", "container_t", "container_init_t", "container_kvm_t", "container_engine_t")
_PROFILES: Final = ("RuntimeDefault", "Localhost")
_PROBES: Final = ("livenessProbe", "readinessProbe", "startupProbe", "lifecycle.postStart", "lifecycle.preStop")


def _list_security_fields(level: Level) -> tuple[GuardedField, ...]:
    """Returns the fields that the security contexts of pods and containers have alike."""
    context, right = "securityContext", HostRight.PRIVILEGED
    return (
        GuardedField(
            f"{context}.appArmorProfile.type", right, level, "goes without the AppArmor profile of its node", _PROFILES
        ),
        GuardedField(f"{context}.seccompProfile.type", right, level, "goes without a seccomp filter", _PROFILES),
        GuardedField(
            f"{context}.seLinuxOptions.type", right, level, "chooses an SELinux type of its own", _SELINUX_TYPES
        ),
        GuardedField(f"{context}.seLinuxOptions.user", right, level, "chooses an SELinux user", ("",)),
        GuardedField(f"{context}.seLinuxOptions.role", right, level, "chooses an SELinux role", ("",)),
        GuardedField(
            f"{context}.windowsOptions.hostProcess", right, level, "runs as a process of its Windows node", (False,)
        ),
    )


_POD_FIELDS: Final = (
    GuardedField("hostNetwork", HostRight.NETWORK, Level.POD, "uses the network of its node", (False,)),
    GuardedField("hostIPC", HostRight.IPC, Level.POD, "uses the shared memory of its node", (False,)),
    GuardedField("hostPID", HostRight.PID, Level.POD, "sees the processes of its node", (False,)),
    GuardedField("volumes[].hostPath", HostRight.PATH, Level.POD, "mounts files of its node"),
    GuardedField(
        "securityContext.sysctls[].name",
        HostRight.PRIVILEGED,
        Level.POD,
        "sets kernel parameters that are not safe",
        _SYSCTLS,
    ),
    *_list_security_fields(Level.POD),
)
_CONTAINER_FIELDS: Final = (
    GuardedField("ports[].hostPort", HostRight.NETWORK, Level.CONTAINER, "opens a port of its node", (0,)),
    GuardedField("securityContext.privileged", HostRight.PRIVILEGED, Level.CONTAINER, "runs privileged", (False,)),
    GuardedField(
        "securityContext.capabilities.add[]",
        HostRight.PRIVILEGED,
        Level.CONTAINER,
        "adds capabilities beyond the usual ones",
        _CAPABILITIES,
    ),
    GuardedField("securityContext.procMount", HostRight.PRIVILEGED, Level.CONTAINER, "unmasks /proc", ("Default",)),
    *_list_security_fields(Level.CONTAINER),
    *(
        GuardedField(
            f"{probe}.{kind}.host", HostRight.PRIVILEGED, Level.CONTAINER, "lets its node call another address", ("",)
        )
        for probe in _PROBES
        for kind in ("httpGet", "tcpSocket")
    ),
)
GUARDED: Final = (
    *_POD_FIELDS,
    *_CONTAINER_FIELDS,
    GuardedField(
        f"annotation {APPARMOR_PREFIX}",
        HostRight.PRIVILEGED,
        Level.ANNOTATIONS,
        "goes without the AppArmor profile of its node",
    ),
)
"""Every field that Pod Security `baseline` of the newest supported Kubernetes forbids."""


def is_free_apparmor(key: str, value: str) -> bool:
    """Decides whether every writer may set this annotation of a pod."""
    return not key.startswith(APPARMOR_PREFIX) or value in FREE_APPARMOR or value.startswith(FREE_APPARMOR_PREFIX)
