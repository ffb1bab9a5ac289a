"""Command line and environment of the scheduler process: every flag is also `ROBOTAPP_SCHEDULER_<FLAG>`."""

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from robotapp_api.values import arguments
from robotapp_claims.protocol.sweeper import PERIOD_S

PREFIX = "ROBOTAPP_SCHEDULER_"
EPILOG = """\
examples:
  robotapp-scheduler --kubeconfig ~/.kube/config --config scheduler.yaml
  robotapp-scheduler --config-map robotapp-system/robotapp-scheduler --lease-namespace robotapp-system

other commands, each with --help:
  robotapp-scheduler simulate        places the waiting pods of a cluster dump, without a cluster
  robotapp-scheduler export          writes such a dump
  robotapp-scheduler bench-plugin    measures what a plugin costs

Every flag may be given as ROBOTAPP_SCHEDULER_<FLAG>, e.g. ROBOTAPP_SCHEDULER_LOG_LEVEL=debug."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line decides; everything about scheduling itself is in the configuration file."""

    kubeconfig: Path | None
    config: Path | None
    config_map: str
    """[NAMESPACE/]NAME of the ConfigMap with the configuration, instead of a file."""
    last_good_config_map: str
    health_host: str
    health_port: int
    tls_certificate: Path | None
    tls_key: Path | None
    sweep_seconds: float
    log_format: str
    log_level: str
    insecure_explain: bool
    lease_namespace: str
    state_dir: Path | None = None
    """Where it is remembered which plugin ended the process; None = nowhere."""
    better_nodes: bool = True
    """Watch the budgets of running apps, and propose better nodes."""


def parse(argv: Sequence[str] | None = None, environment: Mapping[str, str] | None = None) -> Options:
    """Flags win over the environment. Exits with a usage text on a mistake, as argparse does."""
    parser = _parser(os.environ if environment is None else environment)
    found, rest = parser.parse_known_args(argv)
    if rest:
        commands = "" if rest[0].startswith("-") else "; other commands are simulate, export and bench-plugin"
        parser.error(f"unrecognized arguments: {' '.join(rest)}{commands}")
    if (found.tls_cert_file is None) != (found.tls_private_key_file is None):
        parser.error("--tls-cert-file and --tls-private-key-file belong together")
    if found.config is not None and found.config_map:
        parser.error("--config and --config-map exclude each other")
    return Options(
        kubeconfig=found.kubeconfig,
        config=found.config,
        config_map=found.config_map or "",
        last_good_config_map=found.last_good_config_map or "",
        health_host=found.health_host,
        health_port=found.health_port,
        tls_certificate=found.tls_cert_file,
        tls_key=found.tls_private_key_file,
        sweep_seconds=found.sweep_seconds,
        log_format=found.log_format,
        log_level=found.log_level,
        insecure_explain=found.insecure_explain,
        lease_namespace=found.lease_namespace or "",
        state_dir=found.state_dir,
        better_nodes=found.better_nodes == "on",
    )


def _parser(environment: Mapping[str, str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robotapp-scheduler",
        description="Places the pods of robot applications by ROS rules, all others as kube-scheduler 1.37 does.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )

    def given(flag: str, default: str) -> str:
        return environment.get(PREFIX + flag.upper().replace("-", "_"), default)

    def add(
        flag: str,
        text: str,
        *,
        default: str,
        convert: Callable[[str], object] = str,
        choices: Sequence[str] | None = None,
    ) -> None:
        value = given(flag, default)
        # A string default is converted by argparse like a typed argument, so a bad variable is a usage error too.
        parser.add_argument(f"--{flag}", default=value or None, type=convert, choices=choices, help=text)

    add("kubeconfig", "default: the service account of the pod it runs in", default="", convert=Path)
    add("config", "KubeSchedulerConfiguration file; default: built in", default="", convert=Path)
    add("config-map", "[NAMESPACE/]NAME of a ConfigMap with that in scheduler.yaml; followed while running", default="")
    add("last-good-config-map", "[NAMESPACE/]NAME of one to keep the last good configuration in", default="")
    add("health-host", "address of the HTTPS endpoint; without it all, IPv4 and IPv6", default="")
    add("health-port", "port of the HTTPS endpoint, 0 takes a free one", default="10259", convert=arguments.port)
    add("tls-cert-file", "certificate of the endpoint (PEM); default: made at the start", default="", convert=Path)
    add("tls-private-key-file", "key of that certificate (PEM)", default="", convert=Path)
    add("sweep-seconds", "period of the claim sweep", default=str(PERIOD_S), convert=arguments.seconds)
    add(
        "better-nodes",
        "on: a better node is proposed for pods whose latency budget is exceeded (annotation robotics.io/better-node)",
        default="on",
        choices=("on", "off"),
    )
    add("log-format", "json for machines, text for people", default="json", choices=("json", "text"))
    add("log-level", "debug, info, warning or error", default="info", choices=("debug", "info", "warning", "error"))
    add("lease-namespace", "overrides leaderElection.resourceNamespace", default="", convert=arguments.name)
    add(
        "state-dir",
        "folder that outlives the process: plugins that ended it are not asked the same again",
        default="",
        convert=Path,
    )
    parser.add_argument(
        "--insecure-explain",
        action="store_true",
        default=given("insecure-explain", "").lower() in {"1", "true", "yes"},
        help="development only: the port answers without asking who you are",
    )
    return parser
