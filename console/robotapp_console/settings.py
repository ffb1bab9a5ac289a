"""Flags of the console."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

TRUSTED_ROOT: Final = Path("/etc/robotapp-console/ca.crt")
"""Where the chart mounts the cluster's certificate authority."""
DEFAULT_PORT: Final = 8443
_ANYWHERE: Final = "0.0.0.0"  # noqa: S104 - in a pod the Service decides who reaches it


@dataclass(frozen=True, slots=True)
class Settings:
    """`local`: for one person with a kubeconfig, on 127.0.0.1. Otherwise for everybody who can sign in with a token."""

    local: bool = False
    kubeconfig: Path | None = None
    context: str | None = None
    browser: bool = True
    listen: str = _ANYWHERE
    port: int = DEFAULT_PORT
    certificate: Path | None = None
    key: Path | None = None
    plain_http: bool = False
    cookie_key: Path | None = None
    token_header: str = ""
    hosts: tuple[str, ...] = ()
    api_server: str = ""
    certificate_authority: Path | None = None
    scheduler_url: str = ""
    scheduler_authority: Path | None = None
    scheduler_unverified: bool = False
    scheduler_config: str = ""
    log_format: str = "text"
    log_level: str = ""


def parse(argv: Sequence[str] | None = None) -> Settings:
    """Reads the flags; a wrong one ends the process with exit code 2."""
    parser = argparse.ArgumentParser(prog="robotapp-console", description="The fleet, its apps and nodes in a browser.")
    local_flags = parser.add_argument_group("for one person, on this machine")
    local_flags.add_argument("--local", action="store_true", help="serve on 127.0.0.1 with the kubeconfig's user")
    local_flags.add_argument("--kubeconfig", type=Path, metavar="FILE", help="default: $KUBECONFIG, ~/.kube/config")
    local_flags.add_argument("--context", help="context of the kubeconfig")
    local_flags.add_argument("--no-browser", dest="browser", action="store_false", help="print the address only")
    cluster_flags = parser.add_argument_group("for everybody with a token of the cluster")
    cluster_flags.add_argument("--listen", default=_ANYWHERE, metavar="ADDRESS", help="address to listen on")
    cluster_flags.add_argument("--tls-cert-file", dest="certificate", type=Path, metavar="FILE")
    cluster_flags.add_argument("--tls-private-key-file", dest="key", type=Path, metavar="FILE")
    cluster_flags.add_argument(
        "--plain-http", action="store_true", help="no TLS: something in front of the console has it"
    )
    cluster_flags.add_argument(
        "--cookie-key-file", dest="cookie_key", type=Path, metavar="FILE", help="at least 32 bytes; default: random"
    )
    cluster_flags.add_argument(
        "--token-header", default="", metavar="NAME", help="header in which a proxy hands over the user's token"
    )
    cluster_flags.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="NAME",
        help="name under which browsers reach the console; repeatable; default: any",
    )
    cluster_flags.add_argument("--api-server", default="", metavar="URL", help="default: the cluster this pod runs in")
    cluster_flags.add_argument(
        "--certificate-authority", type=Path, metavar="FILE", help=f"of the API server; default: {TRUSTED_ROOT}"
    )
    _add_scheduler_flags(parser)
    parser.add_argument("--port", type=int, help=f"default: {DEFAULT_PORT}, or a free one with --local")
    parser.add_argument("--log-format", choices=("json", "text"), default="text")
    parser.add_argument(
        "--log-level", choices=("debug", "info", "warning", "error"), help="default: info, or error with --local"
    )
    values = vars(parser.parse_args(argv))
    if (values["certificate"] is None) != (values["key"] is None):
        parser.error("--tls-cert-file and --tls-private-key-file belong together")
    if values["port"] is None:
        values["port"] = 0 if values["local"] else DEFAULT_PORT
    values["log_level"] = values["log_level"] or ("error" if values["local"] else "info")
    return Settings(**values | {"hosts": tuple(values["hosts"])})


def _add_scheduler_flags(parser: argparse.ArgumentParser) -> None:
    scheduler_flags = parser.add_argument_group("the scheduler")
    scheduler_flags.add_argument(
        "--scheduler-url",
        default="",
        metavar="URL",
        help="address of its port, for replays; the user's token is sent there",
    )
    scheduler_flags.add_argument(
        "--scheduler-ca",
        dest="scheduler_authority",
        type=Path,
        metavar="FILE",
        help="of its certificate; default: the machine's",
    )
    scheduler_flags.add_argument(
        "--scheduler-unverified", action="store_true", help="believe any certificate: in a network that you trust alone"
    )
    scheduler_flags.add_argument(
        "--scheduler-config", default="", metavar="[NAMESPACE/]NAME", help="ConfigMap with its configuration"
    )
