"""Where the API server is and who we are."""

import base64
import json
import ssl
import stat
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.clients import FakeTime

from robotapp_client.transport.credentials import Credentials, ExecPlugin, Token, file_source
from robotapp_client.transport.errors import LoginError
from robotapp_client.transport.kubeconfig import default_kubeconfigs, load
from robotapp_client.transport.tls_sessions import SessionResumption


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A self-signed certificate and its key."""
    folder = tmp_path_factory.mktemp("pair")
    certificate, key = folder / "crt.pem", folder / "key.pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=me"),
            *("-keyout", str(key), "-out", str(certificate)),
        ],
        check=True,
        capture_output=True,
    )
    return certificate, key


def write(
    path: Path, *, user: dict[str, Any] | None = None, cluster: dict[str, Any] | None = None, **more: Any
) -> Path:
    config = {
        "clusters": [{"name": "c", "cluster": {"server": "https://10.0.0.1:6443/", **(cluster or {})}}],
        "users": [{"name": "u", "user": user or {}}],
        "contexts": [
            {"name": "x", "context": {"cluster": "c", "user": "u", "namespace": "robots"}},
            {"name": "y", "context": {"cluster": "c", "user": "u"}},
        ],
        "current-context": "x",
    } | more
    path.write_text(yaml.safe_dump(config))
    return path


def b64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode()


def test_the_current_context_decides(tmp_path: Path) -> None:
    endpoint = load(write(tmp_path / "k", user={"token": "secret"}))
    assert endpoint.server == "https://10.0.0.1:6443"
    assert endpoint.namespace == "robots"
    assert endpoint.credentials.authorization == "Bearer secret"
    assert endpoint.tls is not None
    assert endpoint.tls.verify_mode == ssl.CERT_REQUIRED
    assert "secret" not in repr(endpoint) + repr(endpoint.credentials)


def test_another_context_may_be_named(tmp_path: Path) -> None:
    assert load(write(tmp_path / "k"), "y").namespace == "default"
    with pytest.raises(LoginError, match="no context 'z'; it has: x, y"):
        load(write(tmp_path / "k"), "z")


def test_sessions_are_taken_up_unless_a_certificate_says_who_we_are(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    """One that is renewed would not be shown again."""
    certificate, key = pair
    users: dict[bool, list[dict[str, Any]]] = {
        True: [{"token": "secret"}],
        False: [
            {"client-certificate": str(certificate), "client-key": str(key)},
            {"exec": {"command": "login", "apiVersion": "client.authentication.k8s.io/v1"}},
        ],
    }
    for taken_up, described in users.items():
        for user in described:
            context = load(write(tmp_path / "k", user=user)).tls
            assert context is not None
            assert (context.sslobject_class is SessionResumption) is taken_up


def test_plain_http_has_no_tls(tmp_path: Path) -> None:
    assert load(write(tmp_path / "k", cluster={"server": "http://127.0.0.1:8001"})).tls is None


def test_client_certificates_come_as_data_or_as_files_beside_the_kubeconfig(
    tmp_path: Path, pair: tuple[Path, Path]
) -> None:
    certificate, key = pair
    as_data = {"client-certificate-data": b64(certificate), "client-key-data": b64(key)}
    load(write(tmp_path / "k", user=as_data, cluster={"certificate-authority-data": b64(certificate)}))
    (tmp_path / "crt.pem").write_bytes(certificate.read_bytes())
    (tmp_path / "key.pem").write_bytes(key.read_bytes())
    as_files = {"client-certificate": "crt.pem", "client-key": "key.pem"}
    endpoint = load(write(tmp_path / "k", user=as_files, cluster={"certificate-authority": "crt.pem"}))
    assert endpoint.tls is not None
    assert len(endpoint.tls.get_ca_certs()) == 1


def test_no_private_key_is_left_behind(
    tmp_path: Path, pair: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = tmp_path / "tmp"
    spool.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(spool))
    user = {"client-certificate-data": b64(pair[0]), "client-key-data": b64(pair[1])}
    load(write(tmp_path / "k", user=user))
    assert list(spool.iterdir()) == []


def test_insecure_is_only_what_the_file_says(tmp_path: Path) -> None:
    endpoint = load(write(tmp_path / "k", cluster={"insecure-skip-tls-verify": True, "tls-server-name": "api.local"}))
    assert endpoint.tls is not None
    assert endpoint.tls.verify_mode == ssl.CERT_NONE
    assert endpoint.server_hostname == "api.local"


@pytest.mark.parametrize(
    ("user", "cluster", "message"),
    [
        ({"client-certificate-data": "AAAA"}, {}, "without its key"),
        ({"client-certificate-data": "***", "client-key-data": "AAAA"}, {}, "client-certificate-data is not base64"),
        ({"client-certificate-data": "AAAA", "client-key-data": "AAAA"}, {}, "do not fit"),
        ({"client-certificate": "missing", "client-key": "missing"}, {}, "cannot read the client-certificate"),
        ({"auth-provider": {"name": "oidc"}}, {}, "use an exec plug-in"),
        ({"username": "admin"}, {}, "'username' is not supported"),
        ({"as": "root"}, {}, "'as' is not supported"),
        ({}, {"server": "10.0.0.1:6443"}, r"is no http\(s\) URL"),
        ({}, {"proxy-url": "ftp://x"}, "proxy-url is no address of a proxy"),
        ({}, {"certificate-authority": "missing"}, "authority cannot be loaded"),
        ({}, {"certificate-authority-data": "AAAA"}, "authority cannot be loaded"),
    ],
)
def test_what_cannot_work_is_refused_in_one_sentence(
    tmp_path: Path, user: dict[str, Any], cluster: dict[str, Any], message: str
) -> None:
    with pytest.raises(LoginError, match=message):
        load(write(tmp_path / "k", user=user, cluster=cluster))


@pytest.mark.parametrize(
    ("text", "message"),
    [("- a\n", "holds no mapping"), ("a: [", "is not YAML"), ("{}", "no current-context; name one of: none defined")],
)
def test_files_that_are_no_kubeconfig_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "k"
    path.write_text(text)
    with pytest.raises(LoginError, match=message):
        load(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LoginError, match="cannot read the kubeconfig"):
        load(tmp_path / "absent")


def test_several_files_are_merged_and_the_first_wins(tmp_path: Path) -> None:
    first = tmp_path / "a" / "k"
    first.parent.mkdir()
    first.write_text(yaml.safe_dump({"users": [{"name": "u", "user": {"token": "first"}}]}))
    second = write(tmp_path / "k", user={"token": "second"})
    assert load([first, second]).credentials.authorization == "Bearer first"


def test_people_get_the_kubeconfig_kubectl_would_take(tmp_path: Path) -> None:
    (tmp_path / ".kube").mkdir()
    home, other = write(tmp_path / ".kube" / "config"), write(tmp_path / "other")
    assert default_kubeconfigs({"HOME": str(tmp_path)}) == [home]
    assert default_kubeconfigs({"HOME": str(tmp_path), "KUBECONFIG": f"{other}:{tmp_path}/absent"}) == [other]


def test_nobody_guesses_a_cluster(tmp_path: Path) -> None:
    with pytest.raises(LoginError, match="use --kubeconfig FILE"):
        load(None, service_account=tmp_path, environ={"HOME": str(tmp_path)})


def test_a_kubeconfig_variable_that_leads_nowhere_is_named(tmp_path: Path) -> None:
    environ = {"HOME": str(tmp_path), "KUBECONFIG": "/no/such"}
    with pytest.raises(LoginError, match=r"\$KUBECONFIG names /no/such, where no file is"):
        load(default_kubeconfigs(environ), service_account=tmp_path, environ=environ)


async def test_in_a_pod_the_service_account_is_read_again_when_due(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    (tmp_path / "token").write_text("one\n")
    (tmp_path / "namespace").write_text("robots\n")
    (tmp_path / "ca.crt").write_bytes(pair[0].read_bytes())
    environ = {"KUBERNETES_SERVICE_HOST": "fd00::1", "KUBERNETES_SERVICE_PORT": "443"}
    endpoint = load(None, service_account=tmp_path, environ=environ)
    assert (endpoint.server, endpoint.namespace) == ("https://[fd00::1]:443", "robots")
    assert endpoint.credentials.due
    await endpoint.credentials.refresh()
    assert endpoint.credentials.authorization == "Bearer one"


async def test_a_token_file_is_read_once_a_minute(tmp_path: Path) -> None:
    time = FakeTime()
    path = tmp_path / "token"
    path.write_text("one")
    credentials = Credentials(file_source(path), clock=time.clock)
    await credentials.refresh()
    path.write_text("two")
    await credentials.refresh()
    assert credentials.authorization == "Bearer one"
    time.now_s += 61
    assert credentials.due
    await credentials.refresh()
    assert credentials.authorization == "Bearer two"


async def test_after_a_401_the_first_one_asks_and_the_others_take_its_answer() -> None:
    asked: list[int] = []

    async def source() -> Token:
        asked.append(1)
        return Token(f"t{len(asked)}")

    credentials = Credentials(source)
    await credentials.refresh()
    assert await credentials.refresh(seen_generation=1)
    assert await credentials.refresh(seen_generation=1)
    assert len(asked) == 2
    assert credentials.authorization == "Bearer t2"


async def test_fixed_credentials_have_nothing_newer() -> None:
    assert not await Credentials.fixed("x").refresh(seen_generation=0)


@pytest.mark.parametrize(("content", "message"), [(None, "cannot read"), ("  \n", "is empty")])
async def test_an_unusable_token_file_is_named(tmp_path: Path, content: str | None, message: str) -> None:
    if content is not None:
        (tmp_path / "token").write_text(content)
    with pytest.raises(LoginError, match=message):
        await file_source(tmp_path / "token")()


def plugin(tmp_path: Path, body: str) -> Path:
    path = tmp_path / "login-plugin"
    path.write_text(f"#!{sys.executable}\nimport json, os, sys\n{body}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


async def test_an_exec_plug_in_gives_a_token_until_it_expires(tmp_path: Path) -> None:
    body = """
info = json.loads(os.environ["KUBERNETES_EXEC_INFO"])
assert info["spec"]["cluster"]["server"], info
token = "-".join(sys.argv[1:] + [os.environ["WHO"], info["apiVersion"]])
print(json.dumps({"status": {"token": token, "expirationTimestamp": "2026-01-01T00:10:00Z"}}))"""
    plugin(tmp_path, body)
    user = {
        "exec": {
            "command": "./login-plugin",
            "args": ["get"],
            "env": [{"name": "WHO", "value": "me"}],
            "apiVersion": "client.authentication.k8s.io/v1beta1",
            "provideClusterInfo": True,
        }
    }
    endpoint = load(write(tmp_path / "k", user=user))
    await endpoint.credentials.refresh()
    assert endpoint.credentials.authorization == "Bearer get-me-client.authentication.k8s.io/v1beta1"


async def test_the_life_of_an_exec_token_is_what_is_left_minus_a_margin(tmp_path: Path) -> None:
    body = 'print(json.dumps({"status": {"token": "t", "expirationTimestamp": "2026-01-01T00:10:00Z"}}))'
    source = ExecPlugin(str(plugin(tmp_path, body)), now=lambda: datetime(2026, 1, 1, tzinfo=UTC))
    assert await source() == Token("t", 570.0)


async def test_an_exec_plug_in_may_give_a_certificate(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    status = {"clientCertificateData": pair[0].read_text(), "clientKeyData": pair[1].read_text()}
    answer = json.dumps({"status": status})
    context = ssl.create_default_context()
    source = ExecPlugin(str(plugin(tmp_path, f"print({answer!r})")), context=context)
    assert await source() == Token("")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("sys.exit('log in first')", "failed .1.: log in first"),
        ("print('hello')", "printed no ExecCredential"),
        ("print('{}')", "printed no ExecCredential"),
        ("print('[]')", "printed no ExecCredential"),
        ('print(json.dumps({"status": {}}))', "neither a token nor a certificate"),
        ('print(json.dumps({"status": {"token": "t", "expirationTimestamp": "soon"}}))', "printed no ExecCredential"),
    ],
)
async def test_a_plug_in_that_fails_is_quoted(tmp_path: Path, body: str, message: str) -> None:
    with pytest.raises(LoginError, match=message):
        await ExecPlugin(str(plugin(tmp_path, body)))()


async def test_a_plug_in_that_is_not_installed_says_how_to_get_it() -> None:
    with pytest.raises(LoginError, match="'no-such-plugin' is not installed; brew install it"):
        await ExecPlugin("no-such-plugin", install_hint="brew install it")()
