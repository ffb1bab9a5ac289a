"""A free API server and our scheduler against it, both processes of their own, and what the scheduler used."""

import asyncio
import base64
import os
import secrets
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
import yaml

from campaigns.common import process_use
from campaigns.free_api.objects import SCHEDULER
from robotapp_client.api.client import ApiClient
from robotapp_client.transport.kubeconfig import load as login
from robotapp_testbed.control_plane.authority import Authority
from robotapp_testbed.processes.process import Process, wait_until

ROOT = Path(__file__).resolve().parents[3]
TOKEN_BYTES = 675
"""900 characters, as the token of a service account has."""
START_S = 60.0
POLL_S = 0.05

Report = dict[str, Any]


class Rig:
    """`async with Rig(folder, nodes=…) as rig:` has a scheduler that leads and has read everything.

    `started` says what that took: wall and CPU seconds, peak memory in bytes.
    """

    def __init__(self, folder: Path, *, nodes: int, placed: int = 0, events: bool = True) -> None:
        self._folder = folder
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "default"}
        kubeconfig = folder / "kubeconfig"

        def process(name: str, *argv: object) -> Process:
            return Process(
                name,
                [sys.executable, "-m", *map(str, argv)],
                run_dir=folder,
                log_path=folder / f"{name}.log",
                env=environment,
            )

        size = ("--nodes", nodes, "--placed", placed)
        self._process = process
        self.stub = process("stub", "campaigns.free_api", *size, "--folder", folder)
        module = "robotapp_scheduler" if events else "campaigns.free_api.silent"
        flags = ("--kubeconfig", kubeconfig, "--config", _configuration(folder), "--log-format", "text")
        self._scheduler = (module, *flags, "--health-host", "127.0.0.1", "--health-port", 0)
        self.scheduler = process("scheduler", *self._scheduler)
        self._kubeconfig = kubeconfig
        self.started: dict[str, float] = {}

    async def __aenter__(self) -> Self:
        try:
            await asyncio.to_thread(self._serve)
            endpoint = await asyncio.to_thread(login, self._kubeconfig)
            self._client = await ApiClient(endpoint, user_agent="bench").__aenter__()
            began_s = time.monotonic()
            self.scheduler.start()
            await self.until(_listens, within_s=START_S)
            self.started = {
                "wall_s": time.monotonic() - began_s,
                "cpu_s": self.cpu_s(),
                "peak_rss_bytes": process_use.peak_rss_bytes(self.scheduler.pid),
            }
        except BaseException:
            self.scheduler.stop()
            self.stub.stop()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._client.__aexit__(kind, error, trace)
        await asyncio.to_thread(self.scheduler.stop)
        await asyncio.to_thread(self.stub.kill)

    def copy(self, name: str) -> Process:
        """Another process like the scheduler, to be started and stopped by the caller: it stands by."""
        return self._process(name, *self._scheduler)

    def cpu_s(self) -> float:
        return process_use.cpu_seconds(self.scheduler.pid)

    async def order(self, what: str) -> None:
        """One of the stub's orders, e.g. "burst?pods=100"."""
        await self._client.request("POST", f"/stub/{what}")

    async def report(self) -> Report:
        answer = await self._client.request("GET", "/stub/report")
        found: Report = msgspec.json.decode(answer.body)
        return found

    async def until(self, wanted: Callable[[Report], bool], *, within_s: float) -> Report:
        """The first report that is as wanted. Raises TimeoutError with what was seen last, and the end of the log."""
        deadline_s = time.monotonic() + within_s
        while not wanted(report := await self.report()):
            if time.monotonic() > deadline_s or not self.scheduler.running:
                seen = {name: value for name, value in report.items() if name != "waited_ms"}
                raise TimeoutError(f"{seen}\n{self.scheduler.log_text()[-2000:]}")
            await asyncio.sleep(POLL_S)
        return report

    def _serve(self) -> None:
        authority = Authority()
        authority.server(self._folder, "localhost")
        self.stub.start()
        if not wait_until(lambda: self._port() > 0, timeout_s=START_S):
            raise TimeoutError(self.stub.log_text())
        self._kubeconfig.write_text(_kubeconfig(authority.pem, self._port()))

    def _port(self) -> int:
        with suppress(ValueError):
            return int(self.stub.log_text())
        return 0


def _listens(report: Report) -> bool:
    """It leads, and would see a pod: the stub keeps no history for who watches later."""
    return bool(report["leases"] and report["watchers"])


def _configuration(folder: Path) -> Path:
    path = folder / "config.yaml"
    config = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaderElect": True, "resourceName": "stub", "resourceNamespace": "kube-system"},
        "profiles": [{"schedulerName": SCHEDULER}],
    }
    path.write_text(yaml.safe_dump(config))
    return path


def _kubeconfig(authority: str, port: int) -> str:
    cluster = {
        "server": f"https://localhost:{port}",
        "certificate-authority-data": base64.b64encode(authority.encode()).decode(),
    }
    config = {
        "apiVersion": "v1",
        "kind": "Config",
        "clusters": [{"name": "stub", "cluster": cluster}],
        "users": [{"name": "stub", "user": {"token": secrets.token_urlsafe(TOKEN_BYTES)}}],
        "contexts": [{"name": "stub", "context": {"cluster": "stub", "user": "stub"}}],
        "current-context": "stub",
    }
    return yaml.safe_dump(config)
