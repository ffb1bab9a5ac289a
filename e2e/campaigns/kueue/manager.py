"""kueue's controller manager as a local process: its manifests, its webhooks on a port of this machine, its certificate."""

import base64
import binascii
import copy
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import yaml

from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.binaries import kueue
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.identity import Identity, service_account
from robotapp_testbed.control_plane.servers import answers
from robotapp_testbed.failures import ApiStatusError, TestbedError
from robotapp_testbed.processes import ports
from robotapp_testbed.processes.process import Process

Json = dict[str, Any]
NAMESPACE: Final = "kueue-system"
ACCOUNT: Final = "kueue-controller-manager"
IDENTITY: Final = "kueue"
WEBHOOKS: Final = "kueue-webhook-service"
SECRET: Final = "kueue-webhook-server-cert"
CERTIFIED_S: Final = 90.0
READY_S: Final = 120.0
_ELSEWHERE: Final = frozenset({"Deployment", "Service", "APIService", "NetworkPolicy"})
"""Kinds of the release that are for its pod: here a process takes its place."""
_WEBHOOK_KINDS: Final = frozenset({"MutatingWebhookConfiguration", "ValidatingWebhookConfiguration"})


def list_identities() -> dict[str, Identity]:
    """Returns the identity of the manager's pod, for a ControlPlane: the release's own roles decide what it may do."""
    return {IDENTITY: service_account(ACCOUNT, namespace=NAMESPACE)}


def install(cp: ControlPlane, port: int) -> None:
    """Applies what the release has besides the manager's pod, with webhooks on a port of this machine."""
    text = cp.kubectl("kustomize", str(kueue.find_manifests()))
    objects = adapt(product.objects_of(text), port)
    first = [item for item in objects if item["kind"] in {"Namespace", "CustomResourceDefinition"}]
    product.define(cp, first)
    cp.kubectl("apply", "--server-side", "-f", "-", stdin=[item for item in objects if item not in first])


def adapt(objects: Iterable[Json], port: int) -> list[Json]:
    """Returns the release's objects for a manager that listens on a port of this machine. Pure.

    The name of its webhooks stays that of its certificate; the Service leads from it to this machine.
    """
    copies = [copy.deepcopy(item) for item in objects if item["kind"] not in _ELSEWHERE]
    for item in copies:
        if item["kind"] in _WEBHOOK_KINDS:
            for webhook in item["webhooks"]:
                webhook["clientConfig"]["service"]["port"] = port
        conversion = item.get("spec", {}).get("conversion", {}) if item["kind"] == "CustomResourceDefinition" else {}
        if "webhook" in conversion:
            conversion["webhook"]["clientConfig"]["service"]["port"] = port
    service = {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": WEBHOOKS, "namespace": NAMESPACE},
        "spec": {"type": "ExternalName", "externalName": "localhost"},
    }
    secret = {"apiVersion": "v1", "kind": "Secret", "metadata": {"name": SECRET, "namespace": NAMESPACE}}
    names = {(item["kind"], item["metadata"]["name"]) for item in copies}
    return [*copies, service, *([] if ("Secret", SECRET) in names else [secret])]


def configure(*, webhook_port: int, health_port: int, certificates: Path) -> Json:
    """Returns the manager's configuration: Jobs are all that it queues here. Pure."""
    return {
        "apiVersion": "config.kueue.x-k8s.io/v1beta2",
        "kind": "Configuration",
        "namespace": NAMESPACE,
        "health": {"healthProbeBindAddress": f"127.0.0.1:{health_port}"},
        "metrics": {"bindAddress": "0"},
        "webhook": {"host": "127.0.0.1", "port": webhook_port, "certDir": str(certificates)},
        "leaderElection": {"leaderElect": False},
        "internalCertManagement": {"enable": True, "webhookServiceName": WEBHOOKS, "webhookSecretName": SECRET},
        "integrations": {"frameworks": ["batch/job"]},
        "featureGates": {"VisibilityOnDemand": False},
    }


def start(cp: ControlPlane) -> Process:
    """Installs kueue and starts its manager; both end with the control plane."""
    program = kueue.build()
    webhook_port, health_port = ports.free_ports(2)
    install(cp, webhook_port)
    certificates = cp.run_dir / "kueue-certificates"
    certificates.mkdir()
    configuration = cp.run_dir / "kueue.yaml"
    content = configure(webhook_port=webhook_port, health_port=health_port, certificates=certificates)
    configuration.write_text(yaml.safe_dump(content))
    process = Process(
        "kueue",
        [program, f"--config={configuration}", "--zap-log-level=2"],
        run_dir=cp.run_dir,
        log_path=cp.logs_dir / "kueue.log",
        env={**os.environ, "KUBECONFIG": str(cp.kubeconfig(IDENTITY))},
        ready=lambda: answers(f"http://127.0.0.1:{health_port}/readyz"),
        ready_timeout_s=READY_S,
    )
    cp.add_process(process).start()
    if not wait_until(lambda: mount(cp, certificates) or not process.running, timeout_s=CERTIFIED_S, poll_s=0.2):
        raise TestbedError(f"kueue has made no certificate after {CERTIFIED_S:.0f} s: see {process.log_path}")
    return process.wait_ready()


def mount(cp: ControlPlane, folder: Path) -> bool:
    """Writes the manager's certificate from its Secret into a folder, as a kubelet does; False while there is none."""
    try:
        data = cp.api.get(f"/api/v1/namespaces/{NAMESPACE}/secrets/{SECRET}").get("data") or {}
    except ApiStatusError:
        return False
    if not {"tls.crt", "tls.key"} <= data.keys():
        return False
    try:
        contents = {name: base64.b64decode(value, validate=True) for name, value in data.items()}
    except binascii.Error as problem:
        raise TestbedError(f"the Secret {SECRET} holds no base64: {problem}") from problem
    for name, content in sorted(contents.items(), reverse=True):
        (folder / name).write_bytes(content)
    return True
