"""TLS contexts made of files that their owner replaces in place: authorities, client certificates, whole kubeconfigs.

The kubelet replaces ca.crt when the cluster's authority is rotated, cert-manager a client's certificate. Connections that stand go
on; each new one is made with what the files say then, and what they no longer say is no longer trusted.
"""

import logging
import ssl
from collections.abc import Callable, Sequence
from pathlib import Path

from robotapp_client.transport.errors import LoginError

log = logging.getLogger(__name__)

Stamp = tuple[tuple[int, int, int] | None, ...]


class TlsFiles:
    """`context` is that of the files as they are now, or the last one that could be made."""

    def __init__(self, paths: Sequence[Path], make: Callable[[], ssl.SSLContext]) -> None:
        """`make` reads the files; it raises LoginError when they cannot be used, here as well."""
        self._paths = tuple(paths)
        self._make = make
        self._stamp = self._read_stamp()
        self._context = make()

    def __repr__(self) -> str:
        return f"<TlsFiles {', '.join(map(str, self._paths))}>"

    @property
    def context(self) -> ssl.SSLContext:
        """Looks at the files' times, which takes microseconds, and reads them when one has changed."""
        stamp = self._read_stamp()
        if stamp != self._stamp:
            self._stamp = stamp
            try:
                self._context = self._make()
            except LoginError as error:  # half written, perhaps: the next change is tried again
                log.warning("the authorities and certificates in use stay: %s", error)
            else:
                log.info("new authorities or certificates are in use: %s", ", ".join(map(str, self._paths)))
        return self._context

    def _read_stamp(self) -> Stamp:
        return tuple(_read_file_stamp(path) for path in self._paths)


def _read_file_stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_ino, status.st_size
