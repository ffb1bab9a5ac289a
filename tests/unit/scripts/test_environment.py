"""scripts/environment behind a proxy that signs every answer of the package index with its own certificate authority.

The index is a server of this test on HTTPS. `uv` is a wheel on it, whose program is the real uv of this environment.
"""

import hashlib
import io
import os
import shutil
import ssl
import subprocess
import sys
import threading
import venv
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from http.server import ThreadingHTTPServer
from pathlib import Path

import pip
import pytest
from e2e.tests.testbed.release_server import ReleaseServer, handler

from robotapp_testbed.binaries import pins, release
from robotapp_testbed.control_plane.authority import Authority

UV = Path(sys.executable).with_name("uv")
SYSTEM_BUNDLE = Path("/etc/ssl/certs/ca-certificates.crt")
OF_THE_USER = ("UV_", "PIP_", "SSL_", "REQUESTS_", "CURL_", "HTTP", "http", "ALL_PROXY", "all_proxy", "PYTHON")


def wheel(name: str, **files: str) -> bytes:
    info = f"{name}-0.13.1.dist-info"
    files[f"{info}/METADATA"] = f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.13.1\n"
    files[f"{info}/WHEEL"] = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    files[f"{info}/RECORD"] = "".join(f"{path},,\n" for path in [*files, f"{info}/RECORD"])
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path, text in files.items():
            member = zipfile.ZipInfo(path)  # of no date: the same name and files give the same bytes
            member.external_attr = 0o100755 << 16
            archive.writestr(member, text)
    return buffer.getvalue()


WHEELS = {
    "tiny": wheel("tiny", **{"tiny.py": "WORD = 'installed'"}),
    "uv": wheel("uv", **{"uv-0.13.1.data/scripts/uv": f'#!/bin/sh\nexec {UV} "$@"\n'}),
}


class QuietServer(ThreadingHTTPServer):
    def handle_error(self, request: object, client_address: object) -> None:
        """A client that refuses our certificate is what these tests are about."""


@dataclass(frozen=True)
class Machine:
    """A project with one locked package, on a machine without certificates of its own but what a test gives it."""

    root: Path
    authorities: Path
    env: dict[str, str]

    def source(self, *before: str, **env: str) -> "subprocess.CompletedProcess[str]":
        command = [*before, "bash", "-c", ". scripts/environment; python -c 'import tiny; print(tiny.WORD)'"]
        return subprocess.run(
            command, cwd=self.root, env=self.env | env, capture_output=True, text=True, check=False, timeout=120
        )


@pytest.fixture(scope="module")
def authority() -> Authority:
    return Authority("authority of a proxy")


@pytest.fixture(scope="module")
def index(authority: Authority, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ReleaseServer]:
    server = ReleaseServer(url="")
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(*authority.server(tmp_path_factory.mktemp("server"), "localhost"))
    with QuietServer(("127.0.0.1", 0), handler(server)) as http:
        http.socket = tls.wrap_socket(http.socket, server_side=True, do_handshake_on_connect=False)
        threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.02}).start()
        for name, content in WHEELS.items():
            file = f"{name}-0.13.1-py3-none-any.whl"
            server.files[f"/files/{file}"] = content
            server.files[f"/{name}/"] = f'<a href="/files/{file}">{file}</a>'.encode()
        try:
            server.url = f"https://localhost:{http.server_address[1]}"
            yield server
        finally:
            http.shutdown()


@pytest.fixture
def machine(index: ReleaseServer, authority: Authority, tmp_path: Path) -> Machine:
    root = tmp_path / "project"
    (root / "scripts").mkdir(parents=True)
    shutil.copy(pins.REPOSITORY / "scripts" / "environment", root / "scripts")
    digest = hashlib.sha256(WHEELS["tiny"]).hexdigest()
    (root / "pyproject.toml").write_text(
        '[project]\nname = "ours"\nversion = "0"\nrequires-python = ">=3.11"\ndependencies = ["tiny"]\n'
    )
    (root / "uv.lock").write_text(
        'version = 1\nrevision = 3\nrequires-python = ">=3.11"\n\n'
        '[[package]]\nname = "ours"\nversion = "0"\nsource = { virtual = "." }\ndependencies = [{ name = "tiny" }]\n\n'
        f'[[package]]\nname = "tiny"\nversion = "0.13.1"\nsource = {{ registry = "{index.url}" }}\n'
        f'wheels = [{{ url = "{index.url}/files/tiny-0.13.1-py3-none-any.whl", hash = "sha256:{digest}" }}]\n'
    )
    venv.create(root / ".venv", symlinks=True)
    (packages,) = (root / ".venv" / "lib").glob("python*/site-packages")
    (packages / "pip").symlink_to(Path(pip.__file__).parent)  # half a second faster than a copy of its own
    authorities = tmp_path / "authorities.pem"
    authorities.write_text(authority.pem)
    env = {name: value for name, value in os.environ.items() if not name.startswith(OF_THE_USER)}
    env |= {"HOME": str(tmp_path), "PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": index.url, "PIP_RETRIES": "0"}
    return Machine(root, authorities, env | {"UV_NO_CACHE": "1", "UV_HTTP_RETRIES": "0"})


def test_a_trust_file_that_the_user_names_serves_pip_and_uv_and_no_bytecode_comes_beside_the_sources(
    machine: Machine,
) -> None:
    done = machine.source(SSL_CERT_FILE=str(machine.authorities), PYTHONDONTWRITEBYTECODE="1")
    assert done.stdout == "installed\n", done.stderr
    assert not list(machine.root.rglob("__pycache__/tiny.*"))
    assert list((machine.root / ".venv" / "bytecode").rglob("tiny.*.pyc")), "it is kept all the same"


def test_the_authorities_of_the_system_serve_pip_and_uv(machine: Machine) -> None:
    namespace = ("unshare", "--map-root-user", "--mount")
    if not SYSTEM_BUNDLE.is_file() or subprocess.run([*namespace, "true"], check=False).returncode != 0:
        pytest.skip(f"no mount namespace, or no {SYSTEM_BUNDLE}, to put another list of authorities there")
    mounted = 'mount --bind "$0" "$1" && shift && exec "$@"'
    done = machine.source(*namespace, "sh", "-c", mounted, str(machine.authorities), str(SYSTEM_BUNDLE))
    assert done.stdout == "installed\n", done.stderr


def test_authorities_that_the_user_gave_pip_stay_and_what_uv_refuses_comes_with_what_to_do(
    machine: Machine, tmp_path: Path
) -> None:
    settings = tmp_path / "pip.conf"
    settings.write_text(f"[global]\ncert = {machine.authorities}\n")
    refused = machine.source(PIP_CONFIG_FILE=str(settings))
    assert (machine.root / ".venv" / "bin" / "uv").exists(), "pip trusted the index"
    assert refused.returncode == 1, "uv did not"
    assert refused.stderr.endswith("set SSL_CERT_FILE=/path/to/authorities.pem. Then run it again.\n")


def test_downloads_of_releases_trust_what_the_machine_trusts(
    index: ReleaseServer, authority: Authority, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    binary = pins.binary("kubectl")
    index.publish(binary, b"released")
    monkeypatch.delenv("SSL_CERT_FILE", raising=False)
    with pytest.raises(release.ReleaseProblem, match="CERTIFICATE_VERIFY_FAILED"):
        release.Downloader(index.base_urls()).fetch(binary, tmp_path / "kubectl")
    (tmp_path / "authorities.pem").write_text(authority.pem)
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "authorities.pem"))
    release.Downloader(index.base_urls()).fetch(binary, tmp_path / "kubectl")
    assert (tmp_path / "kubectl").read_bytes() == b"released"
