"""Bearer tokens that change while we run: projected service-account files and exec plug-ins."""

import asyncio
import json
import os
import ssl
import subprocess
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from robotapp_client.transport.errors import LoginError

FILE_PERIOD_S = 60.0
"""Projected tokens are rewritten when 20 % of their life is left; a minute of delay never meets an expired one."""
EXEC_TIMEOUT_S = 60.0
EXPIRY_MARGIN_S = 30.0


@dataclass(frozen=True, slots=True)
class Token:
    """`value` is empty when authentication is by client certificate; it is requested again after `valid_s` seconds."""

    value: str
    valid_s: float = float("inf")


Source = Callable[[], Awaitable[Token]]


class Credentials:
    """The Authorization header, refreshed from its source when due or when the server answers 401."""

    def __init__(self, source: Source | None = None, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._source = source
        self._clock = clock
        self._lock = asyncio.Lock()
        self._due = 0.0 if source else float("inf")
        self.generation = 0
        self.authorization: str | None = None

    def __repr__(self) -> str:
        return f"<Credentials {'refreshable' if self._source else 'fixed'}, generation {self.generation}>"

    @classmethod
    def fixed(cls, token: str) -> "Credentials":
        credentials = cls()
        credentials.authorization = f"Bearer {token}"
        return credentials

    @classmethod
    def renewable(cls, token: str, read: Callable[[], str]) -> "Credentials":
        """A token without a known end, which is read again when the server refuses it. `read` raises LoginError."""

        async def source() -> Token:
            return Token(read())

        credentials = cls(source)
        credentials._due = float("inf")
        credentials.authorization = f"Bearer {token}"
        return credentials

    @property
    def due(self) -> bool:
        return self._clock() >= self._due

    async def refresh(self, *, seen_generation: int | None = None) -> bool:
        """Read the source again; True when there is something newer than `seen_generation`.

        Many requests find a token expired at the same moment: the first one reads, the others take its result.
        """
        if self._source is None:
            return False
        async with self._lock:
            if seen_generation is None:
                if not self.due:
                    return True
            elif self.generation != seen_generation:
                return True
            before = self.authorization
            token = await self._source()
            self._due = self._clock() + token.valid_s
            self.authorization = f"Bearer {token.value}" if token.value else None
            self.generation += 1
            return self.authorization != before or not token.value


def file_source(path: Path) -> Source:
    """Token of a file that its owner rewrites in place (service accounts, `tokenFile`)."""

    async def read() -> Token:
        return Token(_read_token(path), FILE_PERIOD_S)

    return read


def _read_token(path: Path) -> str:
    try:
        text = path.read_text().strip()
    except OSError as error:
        raise LoginError(f"cannot read the token file {path}: {error.strerror}") from error
    if not text:
        raise LoginError(f"the token file {path} is empty")
    return text


@dataclass(frozen=True, slots=True)
class ExecPlugin:
    """The `exec` section of a kubeconfig user; certificates it returns are loaded into `context`."""

    command: str
    args: Sequence[str] = ()
    env: Mapping[str, str] = field(default_factory=dict)
    api_version: str = "client.authentication.k8s.io/v1"
    install_hint: str = ""
    cluster: Mapping[str, Any] | None = None
    context: ssl.SSLContext | None = None
    now: Callable[[], datetime] = lambda: datetime.now(UTC)

    async def __call__(self) -> Token:
        return await asyncio.to_thread(self._run)

    def _run(self) -> Token:
        info: dict[str, Any] = {"interactive": False}
        if self.cluster is not None:
            info["cluster"] = dict(self.cluster)
        request = {"apiVersion": self.api_version, "kind": "ExecCredential", "spec": info}
        environment = {**os.environ, **self.env, "KUBERNETES_EXEC_INFO": json.dumps(request)}
        argv = [self.command, *self.args]
        try:
            done = subprocess.run(
                argv, env=environment, stdin=subprocess.DEVNULL, capture_output=True, timeout=EXEC_TIMEOUT_S, check=True
            )
        except FileNotFoundError as error:
            hint = f"; {self.install_hint}" if self.install_hint else ""
            raise LoginError(f"the login plug-in {self.command!r} is not installed{hint}") from error
        except subprocess.TimeoutExpired as error:
            raise LoginError(f"the login plug-in {self.command!r} gave no answer in {EXEC_TIMEOUT_S:.0f} s") from error
        except subprocess.CalledProcessError as error:
            output = error.stderr.decode("utf-8", "replace").strip()[-400:]
            raise LoginError(f"the login plug-in {self.command!r} failed ({error.returncode}): {output}") from error
        return self._parse(done.stdout)

    def _parse(self, output: bytes) -> Token:
        try:
            status = json.loads(output)["status"]
            token = str(status.get("token", ""))
            certificate, key = status.get("clientCertificateData"), status.get("clientKeyData")
            expires = status.get("expirationTimestamp")
            until = datetime.fromisoformat(expires) if expires else None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise LoginError(f"the login plug-in {self.command!r} printed no ExecCredential with a status") from error
        if certificate and key and self.context is not None:
            load_pair(self.context, certificate.encode(), key.encode())
        elif not token:
            raise LoginError(f"the login plug-in {self.command!r} returned neither a token nor a certificate")
        if until is None:
            return Token(token)
        return Token(token, max(1.0, (until - self.now()).total_seconds() - EXPIRY_MARGIN_S))


def load_pair(context: ssl.SSLContext, certificate: bytes, key: bytes) -> None:
    """Load PEM bytes into a context; OpenSSL takes files only, so they live for a moment in one only we can read."""
    try:
        with _private_file(certificate.rstrip() + b"\n" + key) as name:
            context.load_cert_chain(name)
    except ssl.SSLError as error:
        raise LoginError(f"the certificate and key do not fit: {error.reason}") from error


@contextmanager
def _private_file(content: bytes) -> Iterator[str]:
    """In memory where the system can (a container may have no writable folder), else a file of mode 0600."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("robotapp", os.MFD_CLOEXEC)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            yield f"/proc/self/fd/{descriptor}"
        return
    descriptor, name = tempfile.mkstemp(prefix="robotapp-")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        yield name
    finally:
        Path(name).unlink()
