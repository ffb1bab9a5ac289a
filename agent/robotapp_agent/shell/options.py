"""Command line and environment of the agent: every flag is also `ROBOTAPP_AGENT_<FLAG>`."""

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotapp_api.values import arguments
from robotapp_api.values.placement.round_trips import LONGEST_INTERVAL_S

PREFIX: Final = "ROBOTAPP_AGENT_"
PROBE_PORT: Final = 7311
"""UDP. Below 7400, where the ports of DDS begin, and outside Linux' ephemeral ports."""
HEALTH_PORT: Final = 7312
SERVICE: Final = "robotapp-agent"
EPILOG: Final = """\
examples:
  robotapp-agent --once                    what the agent sees on this machine, as text; needs no cluster
  robotapp-agent --once --json             the same as the status it would write
  robotapp-agent --once --device-rules rules.yaml    tries a file of device rules
  robotapp-agent --kubeconfig ~/.kube/config --node-name robot-1    outside a pod

Every flag may be given as ROBOTAPP_AGENT_<FLAG>, e.g. ROBOTAPP_AGENT_LOG_LEVEL=debug.
In a pod the node's name comes from the service account's token, else from the variable NODE_NAME."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line decides."""

    kubeconfig: Path | None
    node_name: str
    """ "" = the node of the service account's token."""
    host_root: Path
    """Where the node's /sys, /dev and /run/udev are mounted."""
    service: str
    """Headless Service of all agents, in the agent's own namespace."""
    namespace: str
    """ "" = that of the service account or kubeconfig."""
    probe_port: int
    """UDP, the same on every node; 0 = measure nothing and answer nothing."""
    key_dir: Path | None
    """Folder of the Secret with the keys of the probes; None = no probes."""
    device_rules: Path | None
    features_dir: Path | None
    """Where Node Feature Discovery reads feature files; None = write none."""
    health_port: int
    """TCP; 0 = none."""
    interval_seconds: int
    """0 = by the number of nodes."""
    once: bool
    json: bool
    log_format: str
    log_level: str


def parse(argv: Sequence[str] | None = None, environment: Mapping[str, str] | None = None) -> Options:
    """Flags win over the environment. Exits with a usage text on a mistake, as argparse does."""
    environment = os.environ if environment is None else environment
    parser = _parser(environment)
    found = parser.parse_args(argv)
    if found.json and not found.once:
        parser.error("--json belongs to --once: it prints one status as JSON and ends")
    return Options(
        kubeconfig=found.kubeconfig,
        node_name=found.node_name or "",
        host_root=found.host_root,
        service=found.service,
        namespace=found.namespace or "",
        probe_port=found.probe_port,
        key_dir=found.key_dir,
        device_rules=found.device_rules,
        features_dir=found.features_dir,
        health_port=found.health_port,
        interval_seconds=found.interval_seconds,
        once=found.once,
        json=found.json,
        log_format=found.log_format,
        log_level=found.log_level,
    )


def _interval(text: str) -> int:
    """Whole seconds up to an hour; 0 stands for the rule."""
    if not (text.isascii() and text.isdecimal() and int(text) <= LONGEST_INTERVAL_S):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not an interval; write whole seconds from 0 to {LONGEST_INTERVAL_S}"
        )
    return int(text)


def _parser(environment: Mapping[str, str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robotapp-agent",
        description="Measures the latency to other nodes, finds this node's devices and load, and reports them in its NodeTelemetry.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )

    def add(
        flag: str,
        text: str,
        *,
        default: str = "",
        convert: Callable[[str], object] = str,
        choices: Sequence[str] | None = None,
    ) -> None:
        value = environment.get(PREFIX + flag.upper().replace("-", "_"), default)
        # A string default is converted by argparse like a typed argument, so a bad variable is a usage error too.
        parser.add_argument(f"--{flag}", default=value or None, type=convert, choices=choices, help=text)

    add("kubeconfig", "default: the service account of the pod it runs in", convert=Path)
    add("node-name", "default: the node of the service account's token, else $NODE_NAME", convert=arguments.name)
    add("host-root", "folder with the node's sys, dev and run/udev; default: /", default="/", convert=Path)
    add("service", f"headless Service of all agents; default: {SERVICE}", default=SERVICE, convert=arguments.name)
    add("namespace", "namespace of that Service; default: the service account's", convert=arguments.name)
    probes = f"UDP port of the probes, 0 for none; default: {PROBE_PORT}"
    add("probe-port", probes, default=str(PROBE_PORT), convert=arguments.port)
    add("key-dir", "folder with the keys of the probes (a mounted Secret); default: no probes", convert=Path)
    add("device-rules", "file of rules that name, add or ignore devices; default: none", convert=Path)
    add("features-dir", "folder where Node Feature Discovery reads feature files; default: none", convert=Path)
    health = f"TCP port of /healthz, 0 for none; default: {HEALTH_PORT}"
    add("health-port", health, default=str(HEALTH_PORT), convert=arguments.port)
    add(
        "interval-seconds",
        "time from one heartbeat to the next; default: max(10, nodes / 50)",
        default="0",
        convert=_interval,
    )
    add("log-format", "default: text", default="text", choices=("text", "json"))
    add("log-level", "default: info", default="info", choices=("debug", "info", "warning", "error"))
    parser.add_argument("--once", action="store_true", help="print what the agent sees on this machine, and end")
    parser.add_argument("--json", action="store_true", help="with --once: as the status it would write")
    return parser
