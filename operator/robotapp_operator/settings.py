"""Settings of the operator process: every flag is also ROBOTAPP_OPERATOR_<FLAG>; a flag wins."""

import argparse
import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from robotapp_api.model.distros import DISCOVERY_IMAGE, HELPER_USER, IPV4, IPV6, MASTER_IMAGE, RECORDER_IMAGE
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_api.model.patterns import IMAGE_PATTERN
from robotapp_api.values import arguments
from robotapp_claims.protocol.sweeper import HANDOVER_S, PERIOD_S

PREFIX: Final = "ROBOTAPP_OPERATOR_"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    kubeconfig: Path | None = None
    """Kubeconfig file; without one the pod's service account."""
    namespaces: tuple[str, ...] = ()
    """Namespaces to serve; empty means all."""
    sweep_seconds: float = PERIOD_S
    """Period of the claim sweep; events wake it earlier."""
    handover_seconds: float = HANDOVER_S
    """How long a device waits for the successor of the pod that had it."""
    health_port: int = 8080
    """Port of /healthz, /readyz and /metrics; 0 for none."""
    tls_cert_file: Path | None = None
    """Certificate of that port (PEM); without one it is made at the start."""
    tls_private_key_file: Path | None = None
    scheduler_name: str = SCHEDULER_NAME
    """Scheduler of apps that name none."""
    helper_discovery_image: str = DISCOVERY_IMAGE
    """Image of the Fast DDS discovery servers of apps that write none; `{distro}` stands for the distribution."""
    helper_master_image: str = MASTER_IMAGE
    """Image of the ROS 1 master, likewise."""
    helper_recorder_image: str = RECORDER_IMAGE
    """Image of recordings that write none, likewise."""
    helper_user: int = HELPER_USER
    """User id of discovery servers and master where the components share none; 0 leaves it to the platform."""
    ip_family: str = IPV4
    """IPv4 or IPv6: the family of the pods' first address."""
    lease_namespace: str = ""
    """Namespace of the election Lease; empty means the pod's own, or robotapp-system outside of a cluster."""
    host_access: bool = False
    """Render fields that reach the node. A policy must guard them: the chart sets both together."""
    stop_signals: bool = False
    """Render stop signals: the cluster has the feature gate ContainerStopSignals on."""
    leader_election: bool = True
    """Work only while holding the Lease. It saves work; nothing depends on it."""
    log_format: str = "text"
    """text or json."""


def _parse_image(text: str) -> str:
    """An image with `{distro}` in any place."""
    if not re.fullmatch(IMAGE_PATTERN, text.replace("{distro}", "humble")) or not text:
        raise argparse.ArgumentTypeError(
            f"{text} is no image; write for example registry.example/ros:{{distro}}-ros-base"
        )
    return text


def _parse_user(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**31:
        raise argparse.ArgumentTypeError(f"{text} is no user id; write a number, or 0 to leave it to the platform")
    return int(text)


def _parse_family(text: str) -> str:
    if text not in (IPV4, IPV6):
        raise argparse.ArgumentTypeError(f"{text} is neither {IPV4} nor {IPV6}")
    return text


def _log_format(text: str) -> str:
    if text not in ("text", "json"):
        raise argparse.ArgumentTypeError(f"{text} is neither text nor json")
    return text


_KINDS: Final[Mapping[str, Callable[[str], Any]]] = {
    "kubeconfig": Path,
    "namespaces": arguments.names,
    "sweep_seconds": arguments.seconds,
    "handover_seconds": arguments.seconds,
    "health_port": arguments.port,
    "tls_cert_file": Path,
    "tls_private_key_file": Path,
    "scheduler_name": arguments.name,
    "helper_discovery_image": _parse_image,
    "helper_master_image": _parse_image,
    "helper_recorder_image": _parse_image,
    "helper_user": _parse_user,
    "ip_family": _parse_family,
    "lease_namespace": arguments.name,
    "log_format": _log_format,
}
_HELP: Final = {
    "kubeconfig": "kubeconfig file; without one the pod's service account",
    "namespaces": "namespaces to serve, separated by commas; without it all",
    "sweep_seconds": "period of the claim sweep; events wake it earlier",
    "handover_seconds": "how long a device waits for the next pod of its component",
    "health_port": "port of /healthz, /readyz and /metrics; 0 for none",
    "tls_cert_file": "certificate of that port (PEM); default: made at the start",
    "tls_private_key_file": "key of that certificate (PEM)",
    "scheduler_name": f"scheduler of apps that name none (default: {SCHEDULER_NAME})",
    "helper_discovery_image": "image of Fast DDS discovery servers; {distro} stands for the app's distribution",
    "helper_master_image": "image of the ROS 1 master, likewise",
    "helper_recorder_image": "image of recordings that write none, likewise",
    "helper_user": "user id of their processes where an app's components share none; 0: left to the platform",
    "ip_family": "IPv4 or IPv6: what the pods speak (default: the family of $KUBERNETES_SERVICE_HOST)",
    "lease_namespace": "namespace of the election Lease",
    "log_format": "text or json",
}


def _is_on(environ: Mapping[str, str], name: str) -> bool:
    return environ.get(f"{PREFIX}{name}", "") in ("1", "true", "yes")


def parse(argv: Sequence[str], environ: Mapping[str, str]) -> Settings:
    """Settings from flags, then environment, then defaults. Exits with a sentence on a wrong value."""
    parser = argparse.ArgumentParser(
        prog="robotapp-operator", description="Turns RobotApps into Deployments with DDS domains."
    )
    for name, kind in _KINDS.items():
        flag = name.replace("_", "-")
        fallback = environ.get(PREFIX + name.upper())
        parser.add_argument(f"--{flag}", type=kind, default=fallback, help=_HELP[name])
    guarded = _is_on(environ, "HOST_ACCESS")
    text = "render fields that reach the node, which the chart's policy guards"
    parser.add_argument("--host-access", action="store_true", default=guarded, help=text)
    signals = _is_on(environ, "STOP_SIGNALS")
    text = "render lifecycle.stopSignal: the cluster has the feature gate ContainerStopSignals on"
    parser.add_argument("--stop-signals", action="store_true", default=signals, help=text)
    off = _is_on(environ, "NO_LEADER_ELECTION")
    parser.add_argument("--no-leader-election", action="store_true", default=off, help="work without holding the Lease")
    found = vars(parser.parse_args(argv))
    if (found["tls_cert_file"] is None) != (found["tls_private_key_file"] is None):
        parser.error("--tls-cert-file and --tls-private-key-file belong together")
    if found["ip_family"] is None and ":" in environ.get("KUBERNETES_SERVICE_HOST", ""):
        found["ip_family"] = IPV6
    election = not found.pop("no_leader_election")
    return Settings(leader_election=election, **{name: value for name, value in found.items() if value is not None})
