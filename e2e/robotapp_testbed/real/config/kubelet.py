"""The kubelet's configuration and command line. Pure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from robotapp_testbed.real.config.addresses import CLUSTER_DOMAIN, DNS_SERVICE_IP
from robotapp_testbed.real.config.containerd import SOCKET

FOLDER: Final = "/var/lib/kubelet"
PODS_CGROUP: Final = "kubepods"
"""Folder of all pods below `cgroupRoot`; the name is a constant of the kubelet."""
PRETENDED: Final = (
    "kernel/panic",
    "kernel/panic_on_oops",
    "kernel/keys/root_maxbytes",
    "kernel/keys/root_maxkeys",
    "vm/overcommit_memory",
    "vm/panic_on_oom",
)
"""Settings of the whole machine a kubelet sets at its start: inside its box it sets files instead."""


def configuration(
    *, cgroup: str, certificate: Path, key: Path, client_ca: Path, taints: Sequence[Mapping[str, str]] = ()
) -> dict[str, Any]:
    return {
        "apiVersion": "kubelet.config.k8s.io/v1beta1",
        "kind": "KubeletConfiguration",
        "authentication": {
            "anonymous": {"enabled": False},
            "webhook": {"enabled": True},
            "x509": {"clientCAFile": str(client_ca)},
        },
        "authorization": {"mode": "Webhook"},
        "tlsCertFile": str(certificate),
        "tlsPrivateKeyFile": str(key),
        "cgroupDriver": "cgroupfs",
        "cgroupRoot": f"/{cgroup}",
        "kubeletCgroups": f"/{cgroup}/kubelet",
        "failCgroupV1": False,
        "failSwapOn": False,
        "enforceNodeAllocatable": ["pods"],
        "containerRuntimeEndpoint": f"unix://{SOCKET}",
        "clusterDomain": CLUSTER_DOMAIN,
        "clusterDNS": [DNS_SERVICE_IP],
        "resolvConf": "",
        "volumePluginDir": f"{FOLDER}/volume-plugins",  # the default is a folder of the host that would be created
        "registerWithTaints": [dict(taint) for taint in taints],
        # Faults are noticed in seconds: the API server of a test world is near and has little to do.
        "nodeStatusUpdateFrequency": "4s",
        "nodeStatusReportFrequency": "1m",
        "nodeLeaseDurationSeconds": 10,
        "syncFrequency": "10s",
        # All nodes share the host's disk: what others do to it must not evict pods here.
        "evictionHard": {"memory.available": "100Mi", "nodefs.available": "1%", "imagefs.available": "1%"},
        "imageGCHighThresholdPercent": 100,
        "oomScoreAdj": 0,
    }


def command(
    program: Path, *, config: Path, kubeconfig: Path, name: str, address: str, labels: Mapping[str, str]
) -> list[str]:
    arguments = [
        str(program),
        f"--config={config}",
        f"--kubeconfig={kubeconfig}",
        f"--hostname-override={name}",
        f"--node-ip={address}",
        "--v=2",
    ]
    if labels:
        arguments.append("--node-labels=" + ",".join(f"{key}={value}" for key, value in labels.items()))
    return arguments
