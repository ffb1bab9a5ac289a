"""Proxies as kubectl honours them: which server is reached through which, and that requests and watches get there."""

import asyncio
import ipaddress
import ssl
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, configmap
from tests.support.connect_proxy import TestProxy
from tests.unit.client.transport.test_tls_sessions import connected, tls_server

from robotapp_client import Unreachable
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.connect import Dialer, NotSentError
from robotapp_client.transport.errors import LoginError
from robotapp_client.transport.kubeconfig import Endpoint, follow_authority, load
from robotapp_client.transport.proxy import Proxy, find_proxy, is_direct, parse_proxy
from robotapp_testbed.control_plane.authority import Authority

SERVER = "https://api.example:6443"


@pytest.mark.parametrize(
    ("environ", "proxy"),
    [
        ({}, None),
        ({"HTTPS_PROXY": "http://p:3128"}, "http://p:3128"),
        ({"https_proxy": "http://p:3128"}, "http://p:3128"),
        ({"HTTPS_PROXY": "http://big:1", "https_proxy": "http://small:2"}, "http://big:1"),
        ({"HTTPS_PROXY": "p:3128"}, "http://p:3128"),
        ({"HTTPS_PROXY": "https://p"}, "https://p:443"),
        ({"HTTPS_PROXY": "socks5://p"}, "socks5://p:1080"),
        ({"HTTPS_PROXY": "http://[2001:db8::1]:3128"}, "http://[2001:db8::1]:3128"),
        ({"HTTP_PROXY": "http://p:3128", "ALL_PROXY": "http://p:3128"}, None),
        ({"HTTPS_PROXY": "http://p:3128", "NO_PROXY": "api.example"}, None),
        ({"HTTPS_PROXY": "http://p:3128", "no_proxy": ".example"}, None),
        ({"HTTPS_PROXY": "http://p:3128", "NO_PROXY": "other.example,10.0.0.0/8"}, "http://p:3128"),
    ],
)
def test_the_environment_names_the_proxy_of_a_server(environ: dict[str, str], proxy: str | None) -> None:
    found = find_proxy(SERVER, environ)
    assert (str(found) if found else None) == proxy


@pytest.mark.parametrize(
    ("host", "no_proxy", "direct"),
    [
        ("localhost", "", True),
        ("127.8.0.1", "", True),
        ("::1", "", True),
        ("10.96.0.1", "10.96.0.0/12", True),
        ("10.112.0.1", "10.96.0.0/12", False),
        ("fd00::1", "fd00::/8", True),
        ("10.96.0.1", "10.96.0.1", True),
        ("10.96.0.1", "10.96.0.1:443", False),
        ("10.96.0.1", "10.96.0.1:6443", True),
        ("fd00::1", "[fd00::1]:6443", True),
        ("api.example", "example", True),
        ("api.example", ".example", True),
        ("example", ".example", False),
        ("example", "*.example", False),
        ("api.example", "*.example", True),
        ("myexample", "example", False),
        ("API.Example.", " api.EXAMPLE ", True),
        ("api.example", "api.example:443", False),
        ("api.example", "*", True),
        ("api.example", ",,:80,", False),
        ("api.example", "10.0.0.0/99", False),
    ],
)
def test_no_proxy_holds_names_domains_addresses_and_networks(host: str, no_proxy: str, direct: bool) -> None:
    assert is_direct(host, 6443, no_proxy) is direct


PLAIN_ADDRESSES = st.ip_addresses().filter(lambda address: getattr(address, "ipv4_mapped", None) is None)


@given(PLAIN_ADDRESSES, st.integers(0, 128))
def test_an_address_is_direct_exactly_when_a_network_of_no_proxy_holds_it(address: Any, bits: int) -> None:
    network = ipaddress.ip_network((address, min(bits, address.max_prefixlen)), strict=False)
    other = ipaddress.ip_address(int(address) ^ 1)
    assert is_direct(str(address), 443, f"x,{network}")
    if not other.is_loopback and getattr(other, "ipv4_mapped", None) is None:
        assert is_direct(str(other), 443, str(network)) is (other in network)


@given(st.text(max_size=30), st.text(max_size=30))
def test_any_text_of_no_proxy_is_an_answer(host: str, no_proxy: str) -> None:
    assert is_direct(host, 443, no_proxy) in (True, False)


@pytest.mark.parametrize("text", ["ftp://p:1", "http://", "http://p:99999", "http://[::1", "x y://z", "p:port"])
def test_what_is_no_address_of_a_proxy_is_one_sentence(text: str) -> None:
    with pytest.raises(LoginError) as refused:
        parse_proxy(text, "HTTPS_PROXY")
    assert str(refused.value).startswith("HTTPS_PROXY is no address of a proxy; write http://")


def test_credentials_are_sent_and_shown_nowhere() -> None:
    proxy = parse_proxy("http://me:s%40crt@p:1", "HTTPS_PROXY")
    assert (proxy.user, proxy.password) == ("me", "s@crt")
    assert proxy.authorization == "Basic bWU6c0BjcnQ="
    assert "crt" not in f"{proxy} {proxy!r} {Endpoint(SERVER, proxy=proxy)!r}"


def test_the_proxy_of_a_kubeconfig_counts_whatever_no_proxy_says(tmp_path: Path) -> None:
    def endpoint(**cluster: str) -> Endpoint:
        path = tmp_path / "config"
        named = {"name": "c", "cluster": {"server": SERVER, **cluster}}
        context = {"name": "x", "context": {"cluster": "c"}}
        path.write_text(yaml.safe_dump({"current-context": "x", "clusters": [named], "contexts": [context]}))
        return load(path, environ={"HTTPS_PROXY": "http://env:1", "NO_PROXY": "example"})

    assert endpoint().proxy is None
    assert str(endpoint(**{"proxy-url": "socks5://jump:1080"}).proxy) == "socks5://jump:1080"
    with pytest.raises(LoginError, match="config: proxy-url is no address of a proxy"):
        endpoint(**{"proxy-url": "jump:1080"})


def test_a_pod_has_the_proxy_of_its_environment_unless_the_services_are_in_no_proxy(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("t")
    (tmp_path / "ca.crt").write_text(Authority("x").pem)
    environ = {"KUBERNETES_SERVICE_HOST": "10.96.0.1", "HTTPS_PROXY": "http://p:3128"}
    assert str(load(service_account=tmp_path, environ=environ).proxy) == "http://p:3128"
    assert load(service_account=tmp_path, environ={**environ, "NO_PROXY": "10.96.0.0/12"}).proxy is None


async def test_requests_and_watches_go_through_the_proxy_with_its_credentials() -> None:
    async with FakeApiServer() as api:
        direct = api.endpoint.server.rpartition(":")[2]
        async with TestProxy(int(direct), login="me:secret").serve() as proxy:
            endpoint = Endpoint(
                f"http://api.example:{direct}", proxy=Proxy("http", "127.0.0.1", proxy.port, "me", "secret")
            )
            async with client_for(endpoint) as client:
                await client.create(CONFIGMAPS, configmap("a"))
                assert [item["metadata"]["name"] for item in (await client.list(CONFIGMAPS)).items] == ["a"]
            assert set(proxy.asked) == {f"api.example:{direct}"}
            wrong = Endpoint(endpoint.server, proxy=Proxy("http", "127.0.0.1", proxy.port))
            async with client_for(wrong) as client:
                with pytest.raises(Unreachable, match="wants a user and password") as refused:
                    await client.create(CONFIGMAPS, configmap("b"))
            assert not refused.value.maybe_applied
    assert "secret" not in str(refused.value)


async def test_tls_of_the_server_runs_through_the_proxy_end_to_end(tmp_path: Path) -> None:
    authority = Authority("api")
    (tmp_path / "ca.crt").write_text(authority.pem)
    async with tls_server(tmp_path / "server", authority) as port, TestProxy(port).serve() as proxy:
        there = Proxy("http", "127.0.0.1", proxy.port)
        security = follow_authority(tmp_path / "ca.crt")
        dialer = Dialer(Endpoint(f"https://localhost:{port}", security, proxy=there))
        await connected(dialer)
        await dialer.close()
        stranger = Dialer(Endpoint(f"https://api.example:{port}", security, proxy=there))
        with pytest.raises(NotSentError, match="CERTIFICATE_VERIFY_FAILED"):
            await connected(stranger)
    assert proxy.asked == [f"localhost:{port}", f"api.example:{port}"]


async def test_a_proxy_that_wants_tls_itself_gets_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    authority, of_proxy = Authority("api"), Authority("proxy")
    for name, each in (("api", authority), ("proxy", of_proxy)):
        (tmp_path / f"{name}.crt").write_text(each.pem)
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "proxy.crt"))
    serving = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    pair = of_proxy.server(tmp_path / "pair", "localhost")
    serving.load_cert_chain(*pair)
    async with tls_server(tmp_path / "server", authority) as port, TestProxy(port).serve(tls=serving) as proxy:
        security = follow_authority(tmp_path / "api.crt")
        there = Proxy("https", "localhost", proxy.port)
        dialer = Dialer(Endpoint(f"https://localhost:{port}", security, proxy=there))
        standing = await connected(dialer)
        assert standing.reusable
        await dialer.close()
    assert proxy.asked == [f"localhost:{port}"]


@pytest.mark.parametrize(
    ("host", "asked"), [("api.example", "api.example"), ("10.1.2.3", "0a010203"), ("[fd00::1]", "fd" + "0" * 29 + "1")]
)
async def test_socks_leads_to_names_and_addresses(host: str, asked: str) -> None:
    async with FakeApiServer() as api:
        port = int(api.endpoint.server.rpartition(":")[2])
        async with TestProxy(port, login="me:secret").serve(socks=True) as proxy:
            there = Proxy("socks5", "127.0.0.1", proxy.port, "me", "secret")
            async with client_for(Endpoint(f"http://{host}:{port}", proxy=there)) as client:
                await client.create(CONFIGMAPS, configmap("a"))
            assert proxy.asked == [f"{asked}:{port}"]
            wrong = Proxy("socks5", "127.0.0.1", proxy.port, "me", "guessed")
            async with client_for(Endpoint(f"http://{host}:{port}", proxy=wrong)) as client:
                with pytest.raises(Unreachable, match="refuses the user and password"):
                    await client.create(CONFIGMAPS, configmap("b"))


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"HTTP/1.1 403 Forbidden by rule 7\r\n\r\n", "does not connect to api.example:6443: 403 Forbidden by rule 7"),
        (b"SSH-2.0-OpenSSH\r\n\r\n", "answers CONNECT with no HTTP"),
        (b"HTTP/1.1 200", "the proxy closed the connection"),
        (b"HTTP/1.1 200 OK\r\nX: " + b"y" * 20000, "more than 16384 bytes"),
    ],
)
async def test_what_a_proxy_answers_instead_is_in_the_error(answer: bytes, said: str) -> None:
    async with TestProxy(1, answer=answer).serve() as proxy:
        dialer = Dialer(
            Endpoint("http://api.example:6443", proxy=Proxy("http", "127.0.0.1", proxy.port, "me", "secret"))
        )
        with pytest.raises(NotSentError) as refused:
            await connected(dialer)
    assert said in str(refused.value)
    assert "secret" not in str(refused.value)


async def test_a_proxy_that_is_not_there_is_named() -> None:
    server = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    server.close()
    await server.wait_closed()
    dialer = Dialer(Endpoint("http://api.example:6443", proxy=Proxy("http", "127.0.0.1", port)))
    with pytest.raises(NotSentError, match=f"the proxy http://127.0.0.1:{port} cannot be reached"):
        await connected(dialer)
