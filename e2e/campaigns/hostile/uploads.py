"""A user with the right to view one namespace, who begins to ask the scheduler and never ends."""

import contextlib
import socket
import ssl
from types import TracebackType
from typing import Final, Self
from urllib.parse import urlsplit

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.servers import unverified

BODY_BYTES: Final = 1 << 20
"""As much as a question may have; the last byte is never sent."""
CONNECTION_BYTES: Final = 250_000
"""What a TLS connection with a body on its way holds in buffers of the server at most, beside the budget of bodies."""
PATIENCE_S: Final = 5.0
SOURCE: Final = "127.0.0.3"
"""Another address than that of honest users, who would share its rate of new connections."""


class Uploader:
    """An account that may view the namespace, with its token; gone when the block ends."""

    def __init__(self, plane: ControlPlane, namespace: str, name: str) -> None:
        self._plane = plane
        self._namespace = namespace
        self._name = name
        self._sockets: list[ssl.SSLSocket] = []
        self.token = ""

    def __repr__(self) -> str:
        return f"<Uploader {self._name}: {len(self._sockets)} uploads>"

    def __enter__(self) -> Self:
        where = ("-n", self._namespace)
        account = f"--serviceaccount={self._namespace}:{self._name}"
        self._plane.kubectl("create", "serviceaccount", self._name, *where)
        self._plane.kubectl("create", "rolebinding", self._name, "--clusterrole=view", account, *where)
        self.token = self._plane.kubectl("create", "token", self._name, *where).strip()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for upload in self._sockets:
            upload.close()

    def begin(self, url: str, uploads: int, *, chunked: bool = False) -> None:
        """Sends that many questions but for their last byte. The length of a chunked body is not promised in the head."""
        parts = urlsplit(url)
        head = f"POST {parts.path}?{parts.query} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {self.token}\r\n"
        if chunked:
            head += f"Transfer-Encoding: chunked\r\n\r\n{BODY_BYTES:x}\r\n"
        else:
            head += f"Content-Length: {BODY_BYTES}\r\n\r\n"
        for _ in range(uploads):
            with contextlib.suppress(OSError):  # the server may close at any moment
                plain = socket.create_connection(
                    (parts.hostname or "127.0.0.1", parts.port or 443), PATIENCE_S, source_address=(SOURCE, 0)
                )
                upload = unverified().wrap_socket(plain)
                self._sockets.append(upload)
                upload.sendall(head.encode() + b" " * (BODY_BYTES - 1))
