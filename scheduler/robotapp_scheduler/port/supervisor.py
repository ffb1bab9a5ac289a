"""The port as the scheduler's process holds it: an open socket, and a process that serves it and sends its requests here.

Parsing, TLS and the authentication of strangers are work that every client of the port can cause: none of it is done in
the loop that places pods. If the process dies it is started again; connections wait meanwhile, and pods do not.
"""

import asyncio
import logging
import socket
import sys
from contextlib import suppress
from typing import Final

import msgspec

from robotapp_client.serving.server import listen
from robotapp_client.serving.tls import TlsPort, loaded
from robotapp_scheduler.config.flags import Options
from robotapp_scheduler.port.frames import Settings
from robotapp_scheduler.port.request_handler import RequestHandler

log = logging.getLogger(__name__)

SERVER_MODULE: Final = "robotapp_scheduler.port.server_process"
PAUSE_S: Final = 1.0
"""From the end of one that died to the next."""


class PortSupervisor:
    """`opened`, then `run` until cancelled, then `close`."""

    def __init__(self, listener: socket.socket, options: Options, handler: RequestHandler) -> None:
        self._listener = listener
        self._options = options
        self._handler = handler
        self.port = int(listener.getsockname()[1])
        self.starts = 0

    def __repr__(self) -> str:
        return f"<PortSupervisor on port {self.port}, {self.starts} starts>"

    @classmethod
    async def opened(cls, options: Options, handler: RequestHandler) -> "PortSupervisor":
        """Raises `PortError`, and `LoginError` when the given certificate cannot be used."""
        if options.tls_certificate is not None:
            await loaded(TlsPort(options.tls_certificate, options.tls_key))
        return cls(await listen(options.health_host or None, options.health_port), options, handler)

    async def run(self) -> None:
        """Keep one process serving until cancelled."""
        while True:
            status = await self._serve_once()
            log.error(
                "the process that serves port %d ended with %s; the next one starts in %g s", self.port, status, PAUSE_S
            )
            await asyncio.sleep(PAUSE_S)

    def close(self) -> None:
        self._listener.close()

    async def _serve_once(self) -> int:
        ours, theirs = socket.socketpair()
        self.starts += 1
        with theirs:
            inherited = (self._listener.fileno(), theirs.fileno())
            settings = msgspec.json.encode(self._settings(*inherited)).decode()
            process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", SERVER_MODULE, settings, stdin=asyncio.subprocess.DEVNULL, pass_fds=inherited
            )
        try:
            reader, writer = await asyncio.open_unix_connection(sock=ours)
            try:
                await self._handler.serve(reader, writer)
            finally:
                writer.close()
            return await process.wait()
        finally:
            if process.returncode is None:
                with suppress(ProcessLookupError):
                    process.kill()
                await process.wait()

    def _settings(self, listener: int, handler: int) -> Settings:
        options = self._options
        return Settings(
            listener=listener,
            handler=handler,
            kubeconfig=str(options.kubeconfig) if options.kubeconfig else None,
            tls_certificate=str(options.tls_certificate) if options.tls_certificate else None,
            tls_key=str(options.tls_key) if options.tls_key else None,
            insecure=options.insecure_explain,
            log_format=options.log_format,
            log_level=options.log_level,
        )
