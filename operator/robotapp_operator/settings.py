"""Settings of the operator process: every flag is also ROBOTAPP_OPERATOR_<FLAG>; a flag wins."""

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

PREFIX: Final = "ROBOTAPP_OPERATOR_"
SYSTEM_NAMESPACE: Final = "robotapp-system"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    kubeconfig: Path | None = None
    """Kubeconfig file; without one the pod's service account."""
    namespaces: tuple[str, ...] = ()
    """Namespaces to serve; empty means all."""
    sweep_seconds: float = 30.0
    """Period of the claim sweep; events wake it earlier."""
    handover_seconds: float = 15.0
    """How long a device waits for the successor of the pod that had it."""
    health_port: int = 8080
    """Port of /healthz, /readyz and /metrics; 0 for none."""
    lease_namespace: str = ""
    """Namespace of the election Lease; empty means the pod's own, or robotapp-system outside of a cluster."""
    leader_election: bool = True
    """Work only while holding the Lease. It saves work; nothing depends on it."""
    log_format: str = "text"
    """text or json."""


def parse(argv: Sequence[str], environ: Mapping[str, str]) -> Settings:
    """Settings from flags, then environment, then defaults. Exits with a sentence on a wrong value."""
    defaults = Settings()

    def default(flag: str, fallback: object) -> object:
        return environ.get(PREFIX + flag.upper().replace("-", "_"), fallback)

    parser = argparse.ArgumentParser(
        prog="robotapp-operator", description="Turns RobotApps into Deployments with DDS domains."
    )
    add = parser.add_argument
    add(
        "--kubeconfig",
        type=Path,
        default=default("kubeconfig", None),
        help="kubeconfig file; without one the pod's service account",
    )
    add(
        "--namespaces",
        type=_names,
        default=default("namespaces", ""),
        help="namespaces to serve, separated by commas; empty means all",
    )
    add(
        "--sweep-seconds",
        type=_positive,
        default=default("sweep-seconds", defaults.sweep_seconds),
        help="period of the claim sweep",
    )
    add(
        "--handover-seconds",
        type=_positive,
        default=default("handover-seconds", defaults.handover_seconds),
        help="how long a device waits for its next pod",
    )
    add(
        "--health-port",
        type=int,
        default=default("health-port", defaults.health_port),
        help="port of /healthz, /readyz and /metrics; 0 for none",
    )
    add("--lease-namespace", default=default("lease-namespace", ""), help="namespace of the election Lease")
    add(
        "--no-leader-election",
        action="store_true",
        default=default("no-leader-election", "") in ("1", "true", "yes"),
        help="work without holding the Lease",
    )
    add(
        "--log-format",
        choices=("text", "json"),
        default=default("log-format", defaults.log_format),
        help="form of log lines",
    )
    found = parser.parse_args(argv)
    if not isinstance(found.namespaces, tuple):
        found.namespaces = _names(found.namespaces)
    return Settings(
        kubeconfig=found.kubeconfig and Path(found.kubeconfig),
        namespaces=found.namespaces,
        sweep_seconds=found.sweep_seconds,
        handover_seconds=found.handover_seconds,
        health_port=found.health_port,
        lease_namespace=found.lease_namespace,
        leader_election=not found.no_leader_election,
        log_format=found.log_format,
    )


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _positive(text: str) -> float:
    seconds = float(text)
    if seconds <= 0:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return seconds
