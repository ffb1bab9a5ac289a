"""A browser as far as the console's live tests need one, and tokens of tenants."""

import http.client
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from http.cookies import SimpleCookie
from urllib.parse import urlencode

from robotapp_testbed import ControlPlane


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


def make_token(plane: ControlPlane, namespace: str, *, role: str = "view") -> str:
    """Returns the token of an account that has this role in this namespace and nothing else."""
    plane.kubectl("create", "serviceaccount", role, "-n", namespace)
    binding = ("create", "rolebinding", role, "-n", namespace, f"--clusterrole={role}")
    plane.kubectl(*binding, f"--serviceaccount={namespace}:{role}")
    return plane.kubectl("create", "token", role, "-n", namespace).strip()
