"""Turn settings into the control plane's processes, each with what tells that it serves."""

import ssl
import urllib.error
import urllib.request
from collections.abc import Iterable, Mapping
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any

import yaml

from robotapp_testbed.control_plane import components
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes.process import Process

_PROBE_TIMEOUT_S = 5.0


class Program(StrEnum):
    ETCD = "etcd"
    API = "kube-apiserver"
    CONTROLLER_MANAGER = "kube-controller-manager"
    KWOK = "kwok"
    SCHEDULER = "kube-scheduler"


def unverified() -> ssl.SSLContext:
    """Returns a new context for our own loopback ports, whose certificates are made at the start and cannot be verified.

    It loads no authorities of the machine: that takes 20 ms of CPU, and a program that starts is probed 50 times a second.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def answers(url: str) -> bool:
    """Whether an HTTP(S) GET of a local address succeeds now."""
    context = unverified() if url.startswith("https:") else None
    try:
        with urllib.request.urlopen(url, timeout=_PROBE_TIMEOUT_S, context=context) as response:  # noqa: S310 - our own loopback URLs
            return bool(response.status == 200)
    except (OSError, urllib.error.URLError):
        return False


class Builder:
    def __init__(
        self, layout: components.Layout, settings: components.Settings, binaries: Mapping[str, Path], api: Api
    ) -> None:
        self._layout = layout
        self._settings = settings
        self._binaries = binaries
        self._api = api

    def store_and_api(self) -> dict[str, Process]:
        """etcd and kube-apiserver, started together: the server retries until its store answers."""
        layout = self._layout
        etcd = self._process(Program.ETCD, components.etcd(layout))
        server = self._process(Program.API, components.kube_apiserver(layout, self._settings))
        etcd.start()
        server.start()
        return {etcd.name: etcd, server.name: server}

    def clients(self, names: Iterable[str], scheduler_config: bool | str | Path) -> dict[str, Process]:
        """The programs that need a serving API server, started together."""
        made = [self._client(Program(name), scheduler_config).start() for name in names]
        return {process.name: process for process in made}

    def _client(self, program: Program, scheduler_config: bool | str | Path) -> Process:
        if program is Program.CONTROLLER_MANAGER:
            return self._process(program, components.kube_controller_manager(self._layout, self._settings))
        if program is Program.KWOK:
            return self._process(program, components.kwok(self._layout, self._settings))
        return self._process(program, components.kube_scheduler(self._write_scheduler_config(scheduler_config)))

    def _process(self, program: Program, args: list[str]) -> Process:
        layout = self._layout
        ready = {
            Program.ETCD: lambda: answers(f"{layout.etcd_url}/health"),
            Program.API: self._api.is_ready,
            Program.CONTROLLER_MANAGER: self._controllers_work,
            Program.KWOK: lambda: answers(f"http://127.0.0.1:{layout.kwok_port}/healthz"),
        }
        before_start = {Program.KWOK: self._drop_node_leases} if self._settings.own_cluster else {}
        return Process(
            program,
            [self._binaries[program], *args, *self._settings.extra.get(program, ())],
            run_dir=layout.run_dir,
            log_path=layout.logs_dir / f"{program}.log",
            env={"HOME": str(layout.run_dir), "PATH": "", **self._settings.environment.get(program, {})},
            before_start=before_start.get(program, lambda: None),
            ready=ready.get(program),
        )

    def _drop_node_leases(self) -> None:
        """A restarted kubelet goes on with its Lease; a restarted kwok has a new name and would wait for the old one's to expire."""
        with suppress(OSError, ApiStatusError):  # without an API server it waits, as two instances would
            self._api.delete("/apis/coordination.k8s.io/v1/namespaces/kube-node-lease/leases")

    def _controllers_work(self) -> bool:
        """It has no health port here; pods can be created once it made the default ServiceAccount."""
        try:
            self._api.get("/api/v1/namespaces/default/serviceaccounts/default")
        except (OSError, ApiStatusError):
            return False
        return True

    def _write_scheduler_config(self, wanted: bool | str | Path) -> Path:
        """The caller's configuration with our kubeconfig and without leader election, or the one for comparisons."""
        kubeconfig = self._layout.kubeconfig(Program.SCHEDULER)
        path = self._layout.run_dir / "kube-scheduler.yaml"
        if isinstance(wanted, bool):
            path.write_text(components.oracle_config(kubeconfig))
            return path
        config: dict[str, Any] = yaml.safe_load(Path(wanted).read_text())
        config["clientConnection"] = {**config.get("clientConnection", {}), "kubeconfig": str(kubeconfig)}
        config["leaderElection"] = {"leaderElect": False}
        path.write_text(yaml.safe_dump(config))
        return path
