"""A real Kubernetes control plane on this machine, as a context manager.

with ControlPlane() as cp:
    cp.kubectl("get", "nodes")
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane import audit as audit_log
from robotapp_testbed.control_plane import components, identity, servers
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.control_plane.authority import Authority
from robotapp_testbed.control_plane.commands import Commands
from robotapp_testbed.control_plane.servers import Program
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes import guard, logs
from robotapp_testbed.processes.process import Process, wait_until

_INTERNAL_IDENTITIES = {
    # The user names the built-in RBAC roles are bound to: these programs have the rights they have everywhere.
    Program.CONTROLLER_MANAGER: "system:kube-controller-manager",
    Program.SCHEDULER: "system:kube-scheduler",
}


_ROTATED_S = 60.0
_ROOM_MB = 160
"""etcd alone makes two files of 64 MB before it stores anything."""


class ControlPlane:
    """etcd and kube-apiserver, and as asked: kube-controller-manager, kwok (simulated kubelets), kube-scheduler.

    `kube_scheduler` is True for a configuration meant for comparisons, or the path of a configuration file.
    `audit` is True for one metadata record per request, or an audit level with bodies (Request, RequestResponse).
    `identities` come on top of admin, operator, scheduler, labeller, tenant and tenant-b.
    `extra_args` are appended to a program's arguments, `environment` to its environment (GOGC, for example), by its name.
    `node_lease_s`: above 500 nodes use 400 or more, else the leases alone keep the API server busy.
    """

    def __init__(
        self,
        *,
        kwok: bool = True,
        controller_manager: bool = True,
        kube_scheduler: bool | str | Path = False,
        audit: bool | str = False,
        identities: Mapping[str, identity.Identity] | None = None,
        extra_args: Mapping[str, Sequence[str]] | None = None,
        environment: Mapping[str, Mapping[str, str]] | None = None,
        node_lease_s: int = 40,
        assets: Assets | None = None,
    ) -> None:
        self._wanted = [Program.ETCD, Program.API]
        self._wanted += [Program.CONTROLLER_MANAGER] if controller_manager else []
        self._wanted += [Program.KWOK] if kwok else []
        self._wanted += [Program.SCHEDULER] if kube_scheduler else []
        self._tools = ["kubectl", "helm"]
        self._kube_scheduler = kube_scheduler
        self._audit_level = "Metadata" if audit is True else audit or ""
        self._identities = {**identity.standard_identities(), **(identities or {})}
        self._identities |= {str(name): identity.Identity(user=user) for name, user in _INTERNAL_IDENTITIES.items()}
        self._identities[Program.KWOK] = identity.Identity(user="system:kwok", groups=("system:masters",))
        self._extra_args = dict(extra_args or {})
        self._environment = dict(environment or {})
        self._node_lease_s = node_lease_s
        self._assets = assets or Assets()
        self._processes: dict[str, Process] = {}
        self._guard: subprocess.Popen[bytes] | None = None
        self._run_dir: Path | None = None
        self._layout: components.Layout | None = None
        self._commands: Commands | None = None
        self._api: Api | None = None
        self._keep_logs = False

    def __repr__(self) -> str:
        return f"<ControlPlane {self._layout.server_url if self._layout else 'not started'} {list(self._processes.values())}>"

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # --- what callers use -------------------------------------------------------------------------------------

    @property
    def server_url(self) -> str:
        return self._started().server_url

    @property
    def ca_file(self) -> Path:
        return self._started().ca_file

    @property
    def run_dir(self) -> Path:
        """Removed at the end; the place for temporary files of whatever runs against this control plane."""
        return self._started().run_dir

    @property
    def bin_dir(self) -> Path:
        """A folder for PATH with kubectl, helm and the servers of this control plane."""
        return self._started().bin_dir

    @property
    def logs_dir(self) -> Path:
        return self._started().logs_dir

    @property
    def binary_names(self) -> list[str]:
        """The binaries of this control plane and of its `bin_dir`; others are never downloaded or compiled for it."""
        return [*self._wanted, *self._tools]

    @property
    def has_controllers(self) -> bool:
        return Program.CONTROLLER_MANAGER in self._wanted

    @property
    def api(self) -> Api:
        """Raw access as admin."""
        if self._api is None:
            raise TestbedError("the control plane is not started")
        return self._api

    def kubeconfig(self, name: str = identity.ADMIN) -> Path:
        if name not in self._identities:
            known = ", ".join(self._identities)
            raise TestbedError(
                f"no identity {name!r}, known are {known}: pass identities={{{name!r}: Identity(…)}} to ControlPlane"
            )
        return self._started().kubeconfig(name)

    def kubectl(self, *args: str, identity: str = "admin", stdin: object = None, check: bool = True) -> str:
        """Standard output of kubectl. `stdin` is text, or an object (or list of them) sent as JSON.

        CommandError when it fails; with check=False what it wrote to both outputs instead.
        """
        return self._run("kubectl", args, identity, stdin=stdin, check=check)

    def helm(self, *args: str, identity: str = "admin", stdin: object = None, check: bool = True) -> str:
        return self._run("helm", args, identity, stdin=stdin, check=check)

    def process(self, name: str) -> Process:
        try:
            return self._processes[name]
        except KeyError:
            raise TestbedError(
                f"{name} is not part of this control plane, which has {', '.join(self._processes)}"
            ) from None

    def pids(self) -> dict[str, int]:
        """Process ids by program name, of what runs now."""
        return {str(name): process.pid for name, process in self._processes.items() if process.running}

    def audit(self, *, since: datetime | None = None) -> list[dict[str, Any]]:
        """Returns the audit records so far, or those of requests that ended after `since` and few others. Needs audit=True."""
        if not self._audit_level:
            raise TestbedError("this control plane keeps no audit log: start it with audit=True")
        return audit_log.read(self._started().audit_log, since=since)

    # --- life -------------------------------------------------------------------------------------------------

    def get_binaries(self) -> dict[str, Path]:
        """Downloads or compiles what is missing, with progress; `start` does it as well. TestbedError when it cannot be had."""
        return self._assets.resolve(self.binary_names)

    def start(self) -> Self:
        """Start everything and wait until it serves (2 to 4 s). On failure nothing is left behind."""
        binaries = self.get_binaries()
        _require_room(Path(tempfile.gettempdir()), self._room_mb())
        self._run_dir = Path(tempfile.mkdtemp(prefix="robotapp-testbed-"))
        try:
            self._guard = self._start_guard(self._run_dir)
            self._layout = self._make_layout(self._run_dir)
            self._commands = Commands(binaries, self._run_dir)
            self._write_files(self._layout, binaries)
            self._start_servers(self._layout, binaries)
        except BaseException:
            self.close()
            raise
        return self

    def close(self) -> None:
        """End every process and remove all files. SIGKILL is right: the state is thrown away."""
        for process in self._processes.values():
            process.kill()
        self._processes.clear()
        if self._api:
            self._api.close()
        if self._layout and self._keep_logs:
            logs.keep(self._layout.logs_dir, self.kept_logs_dir)
        if self._run_dir:
            shutil.rmtree(self._run_dir, ignore_errors=True)
        self._run_dir = self._layout = self._api = None
        if self._guard:
            self._guard.kill()
            self._guard.wait()
            self._guard = None

    def keep_logs(self) -> Path:
        """Ask that the logs survive the end; returns where they will be (in the cache, which keeps the ten newest)."""
        self._keep_logs = True
        return self.kept_logs_dir

    @property
    def kept_logs_dir(self) -> Path:
        return logs.kept_root() / self.run_dir.name

    def learn_new_kinds(self) -> None:
        """Make the garbage collector see new CRDs: it looks every 30 s, and until then children outlive their owners."""
        if self.has_controllers:
            self.process(Program.CONTROLLER_MANAGER).restart()

    def add_process(self, process: Process) -> Process:
        """Adopt a program so that it ends with this control plane (used by robotapp_testbed.control_plane.product)."""
        self._processes[process.name] = process
        return process

    # --- inside -----------------------------------------------------------------------------------------------

    def _started(self) -> components.Layout:
        if self._layout is None:
            raise TestbedError("the control plane is not started: use `with ControlPlane() as cp:`")
        return self._layout

    def _run(self, program: str, args: Sequence[str], name: str, *, stdin: object, check: bool) -> str:
        if self._commands is None:
            raise TestbedError("the control plane is not started")
        return self._commands.run(program, args, kubeconfig=self.kubeconfig(name), stdin=stdin, check=check)

    def _room_mb(self) -> int:
        return _ROOM_MB

    def _start_guard(self, run_dir: Path) -> subprocess.Popen[bytes]:
        return start_guard(run_dir)

    def _make_layout(self, run_dir: Path) -> components.Layout:
        return components.Layout.create(run_dir)

    def _write_files(self, layout: components.Layout, binaries: Mapping[str, Path]) -> None:
        for name, path in binaries.items():
            (layout.bin_dir / name).symlink_to(path.resolve())
        layout.token_file.write_text(identity.token_file(self._identities))
        layout.signing_key.write_text(identity.signing_key())
        layout.audit_policy.write_text(audit_log.policy(self._audit_level or "None"))

    def _start_servers(self, layout: components.Layout, binaries: Mapping[str, Path]) -> None:
        self._api = Api(
            layout.server_url, ca_file=layout.serving_certificate, token=self._identities[identity.ADMIN].token
        )
        settings = components.Settings(
            controller_manager=self.has_controllers,
            audit=bool(self._audit_level),
            node_lease_s=self._node_lease_s,
            extra=self._extra_args,
            environment=self._environment,
        )
        build = servers.Builder(layout, settings, binaries, self._api)
        self._processes |= build.store_and_api()
        self._processes[Program.API].wait_ready(needs=[self._processes[Program.ETCD]])
        layout.ca_file.write_text(identity.last_certificate(layout.serving_certificate.read_text()))
        self._write_kubeconfigs(layout)
        self._processes |= build.clients(
            [name for name in self._wanted if name not in self._processes], self._kube_scheduler
        )
        for process in self._processes.values():
            process.wait_ready()

    def rotate_authority(self, name: str = "next authority") -> None:
        """Starts kube-apiserver anew with a certificate of another authority, which `ca_file` and all kubeconfigs then have.

        Programs that were started before must read these files again; kubectl does so each time.
        """
        layout = self._started()
        authority, server = Authority(name), self.process(Program.API)
        host = urlsplit(layout.server_url).hostname or ""
        certificate, key = authority.server(layout.run_dir / "certificates" / "next", host)
        server.kill()
        layout.serving_certificate.write_text(certificate.read_text() + authority.pem)
        layout.serving_certificate.with_suffix(".key").write_text(key.read_text())
        layout.ca_file.write_text(authority.pem)
        self._write_kubeconfigs(layout)
        old_api, self._api = (
            self._api,
            Api(layout.server_url, ca_file=layout.ca_file, token=self._identities[identity.ADMIN].token),
        )
        if old_api is not None:
            old_api.close()
        server.start()
        if not wait_until(self._api.is_ready, timeout_s=_ROTATED_S):
            raise TestbedError(f"kube-apiserver does not serve with its new certificate, see {self.logs_dir}")

    def _write_kubeconfigs(self, layout: components.Layout) -> None:
        for name, each in self._identities.items():
            text = identity.kubeconfig(each, server_url=layout.server_url, ca_file=layout.ca_file)
            layout.kubeconfig(name).write_text(text)
            layout.kubeconfig(name).chmod(0o600)


def _require_room(folder: Path, needed_mb: int) -> None:
    """A program that meets a full disk ends without a word: its log is on that disk, too."""
    free_mb = shutil.disk_usage(folder).free >> 20
    if free_mb < needed_mb:
        raise TestbedError(
            f"{folder} has {free_mb} MB left, this cluster needs {needed_mb} MB: free some, or name another folder in TMPDIR"
        )


def start_guard(run_dir: Path, *, afterwards: Sequence[str] = (), keeps: Sequence[int] = ()) -> subprocess.Popen[bytes]:
    """`afterwards` is a script with its arguments for the guard to end with; `keeps` are descriptors (locks) it keeps open."""
    command = [sys.executable, "-I", "-S", guard.__file__, str(os.getpid()), str(run_dir), *afterwards]
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        pass_fds=keeps,
    )
