"""A connection to a server through a proxy: CONNECT of HTTP, over TLS where the proxy wants it, or SOCKS 5 (RFC 1928, 1929)."""

import asyncio
import contextlib
import ipaddress
import socket
import ssl
from typing import Final

from robotapp_client.transport.proxy import SOCKS, Proxy

MOST_ANSWER: Final = 16384
"""Bytes of a proxy's answer to CONNECT."""
_PIECE: Final = 65536
_SOCKS_VERSION: Final = 5
_NO_LOGIN: Final = 0
_PASSWORD: Final = 2
_SOCKS_ERRORS: Final = {
    1: "it failed",
    2: "its rules do not allow that",
    3: "the network cannot be reached",
    4: "the host cannot be reached",
    5: "the server refused the connection",
    8: "it does not know such addresses",
}
_RELAYS: Final[set[asyncio.Task[None]]] = set()
"""Relays that run: the event loop itself holds a task only weakly."""


class ProxyError(OSError):
    """The proxy does not make the connection; the text names it without its credentials."""


async def open_tunnel(sock: socket.socket, proxy: Proxy, host: str, port: int) -> socket.socket:
    """Returns a socket whose other end is the server, out of `sock`, which leads to the proxy. Raises OSError; `sock` is closed then."""
    try:
        if proxy.scheme == "https":
            return await _open_secure_tunnel(sock, proxy, host, port)
        talk = _SocketTalk(sock)
        await (_greet_socks if proxy.scheme in SOCKS else _ask_to_connect)(talk, proxy, host, port)
    except BaseException:
        sock.close()
        raise
    return sock


class _SocketTalk:
    """Bytes to and from a proxy over a bare socket; nothing is read beyond what is asked for."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self._loop = asyncio.get_running_loop()

    async def send(self, data: bytes) -> None:
        await self._loop.sock_sendall(self._sock, data)

    async def receive(self, count: int) -> bytes:
        """Returns exactly so many bytes. Raises ProxyError when the proxy hangs up before."""
        parts = b""
        while len(parts) < count:
            piece = await self._loop.sock_recv(self._sock, count - len(parts))
            if not piece:
                raise ProxyError("the proxy closed the connection")
            parts += piece
        return parts


class _StreamTalk:
    """The same over TLS."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    async def send(self, data: bytes) -> None:
        self._writer.write(data)
        await self._writer.drain()

    async def receive(self, count: int) -> bytes:
        try:
            return await self._reader.readexactly(count)
        except asyncio.IncompleteReadError as error:
            raise ProxyError("the proxy closed the connection") from error


async def _ask_to_connect(talk: _SocketTalk | _StreamTalk, proxy: Proxy, host: str, port: int) -> None:
    """Sends CONNECT and reads the head of the answer, byte by byte: what follows is the server's."""
    target = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    lines = [f"CONNECT {target} HTTP/1.1", f"Host: {target}"]
    lines += [f"Proxy-Authorization: {proxy.authorization}"] if proxy.authorization else []
    await talk.send("\r\n".join([*lines, "", ""]).encode())
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        if len(head) >= MOST_ANSWER:
            raise ProxyError(f"the proxy {proxy} answers CONNECT with more than {MOST_ANSWER} bytes")
        head += await talk.receive(1)
    status = head.partition(b"\r\n")[0].decode("latin-1")
    words = status.split(" ", 2)
    if len(words) < 2 or not words[0].startswith("HTTP/1.") or not words[1].isdigit():
        raise ProxyError(f"the proxy {proxy} answers CONNECT with no HTTP: is its address right?")
    if words[1] == "407":
        cure = "refuses the user and password in its address" if proxy.authorization else "wants a user and password"
        raise ProxyError(f"the proxy {proxy} {cure}: http://USER:PASSWORD@HOST:PORT")
    if words[1] != "200":
        raise ProxyError(f"the proxy {proxy} does not connect to {target}: {' '.join(words[1:])[:200]}")


async def _greet_socks(talk: _SocketTalk | _StreamTalk, proxy: Proxy, host: str, port: int) -> None:
    login = bool(proxy.authorization)
    methods = bytes((_NO_LOGIN, _PASSWORD) if login else (_NO_LOGIN,))
    await talk.send(bytes((_SOCKS_VERSION, len(methods))) + methods)
    version, method = await talk.receive(2)
    if version != _SOCKS_VERSION:
        raise ProxyError(f"the proxy {proxy} does not speak SOCKS 5")
    if method == _PASSWORD and login:
        user, password = proxy.user.encode(), proxy.password.encode()
        await talk.send(bytes((1, len(user))) + user + bytes((len(password),)) + password)
        if (await talk.receive(2))[1] != 0:
            raise ProxyError(f"the proxy {proxy} refuses the user and password in its address")
    elif method != _NO_LOGIN:
        raise ProxyError(f"the proxy {proxy} wants a user and password: socks5://USER:PASSWORD@HOST:PORT")
    await talk.send(bytes((_SOCKS_VERSION, 1, 0)) + _socks_address(host) + port.to_bytes(2))
    _, code, _, kind = await talk.receive(4)
    if code:
        raise ProxyError(
            f"the proxy {proxy} does not connect to {host}:{port}: {_SOCKS_ERRORS.get(code, f'error {code}')}"
        )
    length = {1: 4, 4: 16}.get(kind) or (await talk.receive(1))[0]
    await talk.receive(length + 2)


def _socks_address(host: str) -> bytes:
    """The host as SOCKS writes it; the proxy looks names up, because it may be the one that can."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        name = host.encode("idna")
        return bytes((3, len(name))) + name
    return bytes((1 if address.version == 4 else 4,)) + address.packed


async def _open_secure_tunnel(sock: socket.socket, proxy: Proxy, host: str, port: int) -> socket.socket:
    """CONNECT over TLS. The TLS to the server runs inside, so a pair of sockets stands between, with a relay."""
    context = ssl.create_default_context()
    reader, writer = await asyncio.open_connection(sock=sock, ssl=context, server_hostname=proxy.host)
    try:
        await _ask_to_connect(_StreamTalk(reader, writer), proxy, host, port)
        tls_end, relay_end = socket.socketpair()
        tls_end.setblocking(False)
        relay_end.setblocking(False)
    except BaseException:
        writer.transport.abort()
        raise
    relay = asyncio.ensure_future(_relay(relay_end, reader, writer))
    _RELAYS.add(relay)
    relay.add_done_callback(_RELAYS.discard)
    return tls_end


async def _relay(sock: socket.socket, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Carries bytes in both directions until one of the two ends."""
    loop = asyncio.get_running_loop()

    async def carry_out() -> None:
        while data := await loop.sock_recv(sock, _PIECE):
            writer.write(data)
            await writer.drain()

    async def carry_in() -> None:
        while data := await reader.read(_PIECE):
            await loop.sock_sendall(sock, data)

    ways = [asyncio.ensure_future(carry_out()), asyncio.ensure_future(carry_in())]
    try:
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        with contextlib.suppress(Exception):
            await asyncio.gather(*ways, return_exceptions=True)
        writer.transport.abort()
        sock.close()
