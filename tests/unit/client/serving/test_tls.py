"""The TLS port: certificates given, made and exchanged; who a client certificate is."""

import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from aiohttp import web
from tests.support.scripted import ScriptedClient

from robotapp_client.serving.pages import caller
from robotapp_client.serving.port import open_port
from robotapp_client.serving.tls import TlsPort, client_authorities
from robotapp_client.transport.errors import Forbidden, LoginError, NotFound
from robotapp_testbed.control_plane.authority import Authority


@asynccontextmanager
async def served(port: TlsPort) -> AsyncIterator[str]:
    """A page that says who asks."""

    async def who(request: web.Request) -> web.Response:
        found = caller(request)
        return web.Response(text=f"{found.user.name} {','.join(found.user.groups)}" if found.user else found.token)

    app = web.Application()
    app.router.add_get("/", who)
    opened = await open_port(app, host="127.0.0.1", port=0, tls=port.current)
    yield f"https://localhost:{opened.number}/"
    await opened.close()


async def get(url: str, context: ssl.SSLContext, **headers: str) -> str:
    async with aiohttp.ClientSession(headers=headers) as http, http.get(url, ssl=context) as answer:
        return await answer.text()


def trusting(pem: str) -> ssl.SSLContext:
    return ssl.create_default_context(cadata=pem)


def believing() -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


async def test_without_a_certificate_one_is_made_that_encrypts_and_proves_nothing() -> None:
    port = TlsPort()
    port.load()
    async with served(port) as url:
        assert await get(url, believing(), Authorization="Bearer t") == "t"
        with pytest.raises(aiohttp.ClientConnectorCertificateError):
            await get(url, ssl.create_default_context())


async def test_a_given_certificate_is_served_and_exchanged_when_its_files_change(tmp_path: Path) -> None:
    old, new = Authority("old"), Authority("new")
    files = old.server(tmp_path, "localhost")
    port = TlsPort(*files)
    port.load()
    async with served(port) as url:
        assert await get(url, trusting(old.pem), Authorization="Bearer t") == "t"
        new.server(tmp_path, "localhost")
        context = port.context
        port.load()
        assert port.context is context, "the console serves with one context"
        assert await get(url, trusting(new.pem), Authorization="Bearer t") == "t"


async def test_a_pair_that_does_not_fit_is_named_and_the_one_in_use_stays(tmp_path: Path) -> None:
    authority = Authority()
    certificate, key = authority.server(tmp_path / "a", "localhost")
    port = TlsPort(certificate, key)
    port.load()
    async with served(port) as url:
        _, other = Authority().server(tmp_path / "b", "localhost")
        key.write_bytes(other.read_bytes())
        with pytest.raises(LoginError, match=r"tls\.crt.*do not fit"):
            port.load()
        assert await get(url, trusting(authority.pem), Authorization="Bearer t") == "t"


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LoginError, match="none: No such file"):
        TlsPort(tmp_path / "none", tmp_path / "none").load()


async def test_a_client_certificate_of_the_clusters_authority_says_who_asks(tmp_path: Path) -> None:
    clients = Authority()
    port = TlsPort()
    port.load()
    port.trust(clients.pem)
    amy = believing()
    amy.load_cert_chain(*clients.user(tmp_path / "amy", "amy", "tenants"))
    async with served(port) as url:
        assert await get(url, amy) == "amy tenants,system:authenticated"
        assert await get(url, amy, Authorization="Bearer t") == "amy tenants,system:authenticated"
        assert await get(url, believing(), Authorization="Bearer t") == "t", "a certificate is not asked for"


async def test_a_client_certificate_of_somebody_else_is_refused(tmp_path: Path) -> None:
    port = TlsPort()
    port.load()
    port.trust(Authority().pem)
    eve = believing()
    eve.load_cert_chain(*Authority().user(tmp_path / "eve", "amy", "system:masters"))
    async with served(port) as url:
        with pytest.raises(aiohttp.ClientError):
            await get(url, eve)


async def test_who_has_a_certificate_of_an_authority_that_was_taken_out_is_a_stranger(tmp_path: Path) -> None:
    old, new = Authority("old"), Authority("new")
    port = TlsPort()
    port.load()
    port.trust(old.pem + new.pem)
    amy, bob = believing(), believing()
    amy.load_cert_chain(*old.user(tmp_path / "amy", "amy", "tenants"))
    bob.load_cert_chain(*new.user(tmp_path / "bob", "bob", "tenants"))
    async with served(port) as url:
        assert await get(url, amy) == "amy tenants,system:authenticated"
        port.trust(new.pem)
        assert await get(url, bob) == "bob tenants,system:authenticated"
        with pytest.raises(aiohttp.ClientError):
            await get(url, amy)
        port.trust("")
        assert await get(url, bob, Authorization="Bearer t") == "t", "nobody's certificate is asked for"


async def test_a_certificate_that_cannot_be_used_does_not_keep_an_authority_trusted(tmp_path: Path) -> None:
    certificate, key = Authority().server(tmp_path, "localhost")
    port = TlsPort(certificate, key)
    port.load()
    port.trust(Authority().pem)
    key.write_text("no key")
    await port.refresh(ScriptedClient().script("get", Forbidden("no", status=403)))
    assert port.context.verify_mode is ssl.CERT_OPTIONAL, "what cannot be read stays"
    await port.refresh(ScriptedClient().script("get", {"data": {}}))
    assert port.context.verify_mode is ssl.CERT_NONE


async def test_a_serving_certificate_is_no_client_certificate(tmp_path: Path) -> None:
    authority = Authority()
    port = TlsPort()
    port.load()
    port.trust(authority.pem)
    server = believing()
    server.load_cert_chain(*authority.server(tmp_path / "s", "localhost"))
    async with served(port) as url:
        with pytest.raises(aiohttp.ClientError):
            await get(url, server)


@pytest.mark.parametrize("text", ["", "no certificate", "kein gültiges", 7])
async def test_authorities_that_cannot_be_used_leave_client_certificates_unasked(text: Any) -> None:
    port = TlsPort()
    port.trust(text)
    assert port.context.verify_mode is ssl.CERT_NONE


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        ({"data": {"client-ca-file": "PEM"}}, "PEM"),
        ({"data": None}, ""),
        ({}, ""),
        (NotFound("none", status=404), ""),
        (Forbidden("no", status=403), None),
    ],
)
async def test_the_authorities_are_those_the_api_server_publishes(answer: Any, text: str | None) -> None:
    client = ScriptedClient().script("get", answer)
    assert await client_authorities(client) == text
    assert client.calls[0][1].endswith("/kube-system/configmaps/extension-apiserver-authentication")
