"""Proxies in this process: CONNECT of HTTP, with TLS on request, and SOCKS 5. They know no names: all lead to one port."""

import asyncio
import base64
import contextlib
import ssl
from collections.abc import AsyncIterator
from dataclasses import dataclass, field


@dataclass(slots=True)
class TestProxy:
    """A proxy that leads every host to `target` on this machine. `login` is user:password; empty lets everybody through."""

    __test__ = False
    target: int
    login: str = ""
    answer: bytes = b""
    """What is sent in place of an answer to CONNECT."""
    asked: list[str] = field(default_factory=list)
    """host:port of each connection that was asked for."""
    port: int = 0
    _writers: list[asyncio.StreamWriter] = field(default_factory=list)

    @contextlib.asynccontextmanager
    async def serve(self, *, socks: bool = False, tls: ssl.SSLContext | None = None) -> AsyncIterator["TestProxy"]:
        handler = self._serve_socks if socks else self._serve_connect
        server = await asyncio.start_server(handler, "127.0.0.1", 0, ssl=tls)
        self.port = server.sockets[0].getsockname()[1]
        try:
            yield self
        finally:
            server.close()
            for writer in self._writers:
                writer.transport.abort()
            for writer in self._writers:
                with contextlib.suppress(OSError, ssl.SSLError):
                    await writer.wait_closed()

    async def _serve_connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        self.asked.append(head.split()[1])
        wanted = base64.b64encode(self.login.encode()).decode()
        if self.answer:
            writer.write(self.answer)
            writer.close()
        elif self.login and f"Proxy-Authorization: Basic {wanted}\r\n" not in head:
            writer.write(b"HTTP/1.1 407 Proxy Authentication Required\r\nContent-Length: 0\r\n\r\n")
            writer.close()
        else:
            writer.write(b"HTTP/1.1 200 Connection established\r\nVia: test\r\n\r\n")
            await self._join(reader, writer)

    async def _serve_socks(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        _, count = await reader.readexactly(2)
        methods = await reader.readexactly(count)
        if self.login:
            writer.write(b"\x05\x02" if 2 in methods else b"\x05\xff")
            if 2 not in methods:
                writer.close()
                return
            user = await reader.readexactly((await reader.readexactly(2))[1])
            password = await reader.readexactly((await reader.readexactly(1))[0])
            fits = f"{user.decode()}:{password.decode()}" == self.login
            writer.write(b"\x01\x00" if fits else b"\x01\x01")
            if not fits:
                writer.close()
                return
        else:
            writer.write(b"\x05\x00")
        kind = (await reader.readexactly(4))[3]
        host = await reader.readexactly((await reader.readexactly(1))[0] if kind == 3 else 4 if kind == 1 else 16)
        port = int.from_bytes(await reader.readexactly(2))
        self.asked.append(f"{host.decode() if kind == 3 else host.hex()}:{port}")
        writer.write(b"\x05\x00\x00\x01" + bytes(6))
        await self._join(reader, writer)

    async def _join(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry bytes between the client and the target until one of them ends."""
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self.target)
        self._writers.append(far_writer)
        await asyncio.gather(_carry(reader, far_writer), _carry(far_reader, writer))


async def _carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()
    writer.close()
