"""The console as a program of this machine, for one user of a control plane: what `kubectl robotapp console` starts."""

import http.client
import os
import re
import sys
from dataclasses import dataclass
from typing import Final

from robotapp_testbed.control_plane import identity
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes import ports
from robotapp_testbed.processes.process import Process, wait_until

_ADDRESS: Final = re.compile(r"once: (http://\S+)$", re.MULTILINE)
_READY_S: Final = 60.0
_ANSWER_S: Final = 30.0


@dataclass(frozen=True, slots=True)
class LocalConsole:
    """A running console. Each one-time address opens one browser; `address` is the newest."""

    process: Process
    port: int

    @property
    def origin(self) -> str:
        """The beginning of every page's address."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def address(self) -> str:
        """The one-time address that the console printed last."""
        addresses = _ADDRESS.findall(self.process.log_text())
        if not addresses:
            raise TestbedError(f"the console has printed no address. {self.process.log_tail()}")
        return str(addresses[-1])

    def open_session(self) -> str:
        """Uses the newest one-time address and returns the session's cookie; waits until the next address is printed."""
        address = self.address
        status, _, cookie = self._request(address.removeprefix(self.origin), "")
        if status != 303 or not cookie:
            raise TestbedError(f"the console refused its own address with {status}. {self.process.log_tail()}")
        wait_until(lambda: self.address != address, timeout_s=_ANSWER_S)
        return cookie.partition(";")[0]

    def read_page(self, path: str, session: str) -> tuple[int, str]:
        """Returns the status and the text of a page, as a browser without scripts gets it."""
        status, text, _ = self._request(path, session)
        return status, text

    def _request(self, path: str, session: str) -> tuple[int, str, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=_ANSWER_S)
        try:
            connection.request("GET", path, headers={"Accept": "text/html", "Cookie": session})
            answer = connection.getresponse()
            return answer.status, answer.read().decode(), answer.headers.get("Set-Cookie", "")
        finally:
            connection.close()


def start_console(
    cp: ControlPlane, *, user: str = identity.ADMIN, name: str = "console", scheduler_url: str = ""
) -> LocalConsole:
    """Starts the console with the kubeconfig of this user and waits until it serves. It ends with the control plane.

    scheduler_url: the port of our scheduler, which replays placements.
    """
    (port,) = ports.free_ports(1)
    flags = ["--local", "--no-browser", f"--port={port}", f"--kubeconfig={cp.kubeconfig(user)}"]
    flags += [f"--scheduler-url={scheduler_url}"] if scheduler_url else []
    process = Process(
        name,
        [sys.executable, "-m", "robotapp_console", *flags],
        run_dir=cp.run_dir,
        log_path=cp.logs_dir / f"{name}.log",
        env={key: value for key, value in os.environ.items() if key != "KUBECONFIG"},
        ready=lambda: _is_open(port),
        ready_timeout_s=_READY_S,
    )
    console = LocalConsole(process, port)
    cp.add_process(process).start().wait_ready()
    wait_until(lambda: bool(_ADDRESS.search(process.log_text())), timeout_s=_ANSWER_S)
    return console


def _is_open(port: int) -> bool:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=1.0)
    try:
        connection.request("GET", "/healthz")
        return connection.getresponse().status == 200
    except OSError:
        return False
    finally:
        connection.close()
