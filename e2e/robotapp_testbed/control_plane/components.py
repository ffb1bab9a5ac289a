"""The command lines of the control plane's programs. Pure: paths and ports in, argument lists out."""

import ipaddress
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from robotapp_api.model.names import Label
from robotapp_testbed.processes import ports

STAGES_DIR = Path(__file__).parents[1] / "stages"
SIMULATED_BY_KWOK = "kwok"
RUNS_FOR = "testbed.robotapp.dev/runs-for"
"""Annotation of a simulated pod of a Job: how long it runs before it ends, such as 5s. Without it, it ends at once."""
NODE_SELECTOR = f"{Label.SIMULATED}={SIMULATED_BY_KWOK}"
"""kwok plays the kubelet of nodes with this label only, so real nodes can join the same control plane."""

SERVICE_NETWORK = "10.96.0.0/16"
_ETCD_QUOTA_BYTES = 8 << 30
_GRACE_OVER_LEASE_S = 10


@dataclass(frozen=True)
class Layout:
    """Where one control plane keeps its files and listens."""

    run_dir: Path
    etcd_port: int
    etcd_peer_port: int
    api_port: int
    kwok_port: int
    foreign_url: str = ""
    host: str = "127.0.0.1"
    """The address the API server listens on: another one when nodes of their own have to reach it."""

    @classmethod
    def create(cls, run_dir: Path, *, server_url: str = "") -> "Layout":
        """Folders and free ports; `server_url` is that of an API server that is not ours."""
        for folder in ("bin", "logs", "certificates", "kubeconfigs"):
            (run_dir / folder).mkdir()
        etcd, etcd_peer, api, kwok_port = ports.free_ports(4)
        return cls(run_dir, etcd, etcd_peer, api, kwok_port, foreign_url=server_url)

    @property
    def server_url(self) -> str:
        return self.foreign_url or f"https://{self.host}:{self.api_port}"

    @property
    def etcd_url(self) -> str:
        return f"http://127.0.0.1:{self.etcd_port}"

    @property
    def serving_certificate(self) -> Path:
        """kube-apiserver writes its certificate and, after it, that of the authority that signed it at its first start."""
        return self.run_dir / "certificates" / "apiserver.crt"

    @property
    def ca_file(self) -> Path:
        """The authority alone, as pods get it; written when the server has made it."""
        return self.run_dir / "certificates" / "ca.crt"

    @property
    def token_file(self) -> Path:
        return self.run_dir / "tokens.csv"

    @property
    def signing_key(self) -> Path:
        return self.run_dir / "service-account.key"

    @property
    def audit_policy(self) -> Path:
        return self.run_dir / "audit-policy.yaml"

    @property
    def audit_log(self) -> Path:
        return self.logs_dir / "audit.jsonl"

    @property
    def bin_dir(self) -> Path:
        return self.run_dir / "bin"

    @property
    def logs_dir(self) -> Path:
        return self.run_dir / "logs"

    def kubeconfig(self, identity: str) -> Path:
        return self.run_dir / "kubeconfigs" / f"{identity}.yaml"


@dataclass(frozen=True)
class Settings:
    """What differs between control planes."""

    controller_manager: bool = True
    audit: bool = False
    node_lease_s: int = 40
    own_cluster: bool = True
    """False: the API server is somebody else's, and so are most nodes."""
    extra: Mapping[str, Sequence[str]] = field(default_factory=dict)
    environment: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def etcd(layout: Layout) -> list[str]:
    peer = f"http://127.0.0.1:{layout.etcd_peer_port}"
    return [
        f"--data-dir={layout.run_dir / 'etcd'}",
        f"--listen-client-urls={layout.etcd_url}",
        f"--advertise-client-urls={layout.etcd_url}",
        f"--listen-peer-urls={peer}",
        f"--initial-advertise-peer-urls={peer}",
        f"--initial-cluster=default={peer}",
        "--unsafe-no-fsync",  # the data is thrown away with the control plane
        f"--quota-backend-bytes={_ETCD_QUOTA_BYTES}",
        "--log-level=error",
    ]


def kube_apiserver(layout: Layout, settings: Settings) -> list[str]:
    args = [
        f"--etcd-servers={layout.etcd_url}",
        f"--bind-address={layout.host}",
        f"--secure-port={layout.api_port}",
        f"--cert-dir={layout.serving_certificate.parent}",
        f"--token-auth-file={layout.token_file}",
        "--authorization-mode=Node,RBAC",
        "--service-account-issuer=https://kubernetes.default.svc",
        f"--service-account-key-file={layout.signing_key}",
        f"--service-account-signing-key-file={layout.signing_key}",
        f"--service-cluster-ip-range={SERVICE_NETWORK}",
        "--allow-privileged=true",
    ]
    if ipaddress.ip_address(layout.host).is_loopback:  # the server refuses to make it an endpoint of its Service
        args.append("--endpoint-reconciler-type=none")
    if not settings.controller_manager:  # nobody would create the default ServiceAccounts that pods need
        args.append("--disable-admission-plugins=ServiceAccount")
    if settings.audit:
        args += [
            f"--audit-policy-file={layout.audit_policy}",
            f"--audit-log-path={layout.audit_log}",
            "--audit-log-maxsize=4096",
        ]
    return args


def kube_controller_manager(layout: Layout, settings: Settings) -> list[str]:
    return [
        f"--kubeconfig={layout.kubeconfig('kube-controller-manager')}",
        f"--service-account-private-key-file={layout.signing_key}",
        f"--root-ca-file={layout.ca_file}",
        "--use-service-account-credentials=true",  # each controller has the rights it has in any cluster
        "--kube-api-qps=1000",  # the default of 20 would be the limit of every test that creates many pods
        "--kube-api-burst=1000",
        "--leader-elect=false",
        "--secure-port=0",
        f"--node-monitor-grace-period={settings.node_lease_s + _GRACE_OVER_LEASE_S}s",
    ]


def kwok(layout: Layout, settings: Settings) -> list[str]:
    stages = [f"--config={path}" for path in sorted(STAGES_DIR.glob("*.yaml"))]
    return [
        f"--kubeconfig={layout.kubeconfig('kwok')}",
        f"--manage-nodes-with-label-selector={NODE_SELECTOR}",
        f"--node-lease-duration-seconds={settings.node_lease_s}",
        f"--server-address=127.0.0.1:{layout.kwok_port}",
        "--cidr=10.64.0.0/10",
        *stages,
    ]


def kube_scheduler(config: Path) -> list[str]:
    return [f"--config={config}", "--secure-port=0"]


def oracle_config(kubeconfig: Path) -> str:
    """kube-scheduler as the oracle of comparisons: every node is scored, one goroutine, no client-side rate limit."""
    return yaml.safe_dump(
        {
            "apiVersion": "kubescheduler.config.k8s.io/v1",
            "kind": "KubeSchedulerConfiguration",
            "clientConnection": {"kubeconfig": str(kubeconfig), "qps": 10000, "burst": 10000},
            "leaderElection": {"leaderElect": False},
            "percentageOfNodesToScore": 100,
            "parallelism": 1,
        }
    )
