"""The console as the chart runs it, in front of a real API server: what a tenant and an administrator see."""

import http.client
import json
import re
import secrets
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from http.cookies import SimpleCookie
from pathlib import Path
from urllib.parse import urlencode

import pytest

from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology

pytestmark = pytest.mark.live
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
ROBOT = "amr-console"


class Console:
    """A process, and a browser's cookies for it."""

    def __init__(self, process: "subprocess.Popen[str]", port: int) -> None:
        self.process = process
        self.port = port
        self.cookies: dict[str, str] = {}

    def get(self, path: str) -> tuple[int, str]:
        return self._ask("GET", path)

    def post(self, path: str, fields: dict[str, str]) -> tuple[int, str]:
        return self._ask("POST", path, urlencode(fields))

    def _ask(self, method: str, path: str, body: str | None = None) -> tuple[int, str]:
        cookies = "; ".join(f"{name}={value}" for name, value in self.cookies.items())
        headers = {"Accept": "text/html", "Cookie": cookies, "Origin": f"http://127.0.0.1:{self.port}"}
        headers |= {"Content-Type": "application/x-www-form-urlencoded"} if body else {}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            for line in answer.headers.get_all("Set-Cookie") or ():
                self.cookies |= {name: morsel.value for name, morsel in SimpleCookie(line).items()}
            return answer.status, answer.read().decode()
        finally:
            connection.close()

    def sign_in(self, token: str, home: str = "") -> int:
        self.cookies.clear()
        _, form = self.get("/login")
        csrf = re.search(r'name="csrf" value="([^"]+)"', form)
        assert csrf is not None
        return self.post("/login", {"token": token, "home": home, "csrf": csrf[1]})[0]


@contextmanager
def serve(plane: ControlPlane, *flags: str) -> Iterator[Console]:
    """Starts a console in front of this API server, and stops it."""
    command = [sys.executable, "-m", "robotapp_console", "--plain-http", "--listen=127.0.0.1", "--port=0", *flags]
    command += [f"--api-server={plane.server_url}", f"--certificate-authority={plane.ca_file}"]
    with subprocess.Popen([*command, "--log-format=json"], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = json.loads(process.stderr.readline())["message"]
        port = re.search(r"port (\d+)", line)
        assert port is not None, line
        yield Console(process, int(port[1]))
        process.terminate()
        assert process.wait(30) == 0


@pytest.fixture(scope="module")
def console(installed_plane: ControlPlane) -> Iterator[Console]:
    with serve(installed_plane) as console:
        yield console


@pytest.fixture(scope="module")
def fleet(installed_plane: ControlPlane) -> Iterator[None]:
    """A robot and an edge server with telemetry, and an operator; nothing places pods."""
    nodes = topology.fleet([ROBOT], 1, 0)
    topology.apply(installed_plane, nodes)
    name = f"operator-{secrets.token_hex(2)}"
    operator = product.start_operator(installed_plane, name=name, sweep_seconds=1, no_leader_election=True)
    with topology.SimulatedTelemetry(installed_plane, nodes):
        yield
    operator.stop()
    topology.remove(installed_plane, nodes)


def make_token(plane: ControlPlane, namespace: str) -> str:
    """Returns the token of a tenant who may view this namespace and nothing else."""
    plane.kubectl("create", "serviceaccount", "viewer", "-n", namespace)
    binding = ("create", "rolebinding", "viewer", "-n", namespace, "--clusterrole=view")
    plane.kubectl(*binding, f"--serviceaccount={namespace}:viewer")
    return plane.kubectl("create", "token", "viewer", "-n", namespace).strip()


def find_refused(page: str) -> str:
    """Returns the kinds that a page says it does not show."""
    return " ".join(re.findall(r"Not shown: ([^<]*)", page))


@pytest.mark.usefixtures("fleet")
def test_a_tenant_sees_its_apps_and_is_told_what_it_may_not_read(
    installed_plane: ControlPlane, console: Console, namespace: str
) -> None:
    installed_plane.kubectl("apply", "-n", namespace, "-f", str(EXAMPLES / "minimal.yaml"))
    token = make_token(installed_plane, namespace)
    console.cookies.clear()
    assert console.get("/")[0] == 303, "a browser without a session is sent to the form"
    assert console.sign_in("none of this cluster") in (401, 422)
    assert console.sign_in(token, namespace) == 303

    def is_shown() -> bool:
        return f'href="/apps/{namespace}/minimal"' in console.get("/")[1]

    assert wait_until(is_shown, timeout_s=30), "the operator's instance is shown as a chip"
    status, page = console.get("/")
    assert status == 200
    assert f"system:serviceaccount:{namespace}:viewer" in page
    for kind in ("Nodes", "NodeTelemetries", "RobotClaims", "DomainPools"):
        assert kind in find_refused(page)
    assert "RobotApps" not in find_refused(page)
    assert token not in page
    assert ROBOT not in page
    status, app = console.get(f"/apps/{namespace}/minimal")
    assert status == 200
    assert "Accepted" in app
    assert "Not shown: events" not in app
    assert "Nodes" in find_refused(console.get("/nodes")[1])


@pytest.mark.usefixtures("fleet")
def test_who_may_read_the_cluster_sees_robots_nodes_and_round_trips(
    installed_plane: ControlPlane, console: Console, namespace: str
) -> None:
    token = make_token(installed_plane, namespace)
    for role in ("view", "robotapp-cluster-viewer"):
        binding = ("create", "clusterrolebinding", f"{namespace}-{role}", f"--clusterrole={role}")
        installed_plane.kubectl(*binding, f"--serviceaccount={namespace}:viewer")
    try:
        assert console.sign_in(token) == 303
        assert wait_until(lambda: "2 ms" in console.get("/")[1], timeout_s=30)
        _, page = console.get("/")
        assert f'id="robot-{ROBOT}"' in page
        assert "Not shown" not in page
        _, nodes = console.get("/nodes")
        assert f'id="node-{ROBOT}"' in nodes
        assert "Not shown" not in nodes
        assert 'class="heat2"' in nodes
    finally:
        for role in ("view", "robotapp-cluster-viewer"):
            installed_plane.kubectl("delete", "clusterrolebinding", f"{namespace}-{role}")
