"""Asking the scheduler why: by a given URL, or through kubectl port-forward to its pod."""

import contextlib
import ipaddress
import ssl
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Final
from urllib.parse import urlsplit

import aiohttp

from robotapp_cli.reading.fields import Json
from robotapp_cli.reading.session import Session, endpoint
from robotapp_client.tools.scheduler_tunnel import NoTunnelError, open_tunnel

_PATIENCE_S: Final = 5.0
_LONG_PATIENCE_S: Final = 70.0
"""For /simulate, which may work for a minute, and /what-if."""


class NoAnswerError(Exception):
    """The scheduler cannot be asked, or refuses; the text says why. `why` is its own text, `status` that of its answer."""

    def __init__(self, text: str, *, why: str = "", status: int = 0) -> None:
        super().__init__(text)
        self.why = why
        self.status = status


@dataclass(slots=True)
class Link:
    """A way to the scheduler's pages. `problem` says why there is none (any more)."""

    base: str = ""
    headers: dict[str, str] = field(default_factory=dict)
    problem: str = ""
    tls: ssl.SSLContext | None = None
    """How its certificate is checked, with the user's own client certificate if there is one."""

    async def fetch(self, namespace: str, pod: str) -> Json | None:
        """The scheduler's record of the pod; None when it has none or cannot be asked."""
        if self.problem:
            return None
        try:
            return await self._ask("GET", f"/explain/{namespace}/{pod}")
        except NoAnswerError as error:
            self.problem = str(error)
            return None

    async def get(self, path: str) -> Json:
        """A page of the scheduler. Raises `NoAnswerError`."""
        return self._needed(path, await self._ask("GET", path))

    async def post(self, path: str, body: bytes) -> Json:
        """The answer to a body. Raises `NoAnswerError`."""
        return self._needed(path, await self._ask("POST", path, body, patience_s=_LONG_PATIENCE_S))

    @property
    def _hint(self) -> str:
        return "; a scheduler speaks https://" if urlsplit(self.base).scheme == "http" else ""

    def _needed(self, path: str, found: Json | None) -> Json:
        if found is None:
            raise NoAnswerError(f"{self.base} knows no {path}: an older scheduler?")
        return found

    async def _ask(
        self, method: str, path: str, body: bytes | None = None, *, patience_s: float = _PATIENCE_S
    ) -> Json | None:
        if self.problem:
            raise NoAnswerError(self.problem)
        try:
            timeout = aiohttp.ClientTimeout(total=patience_s)
            async with (
                aiohttp.ClientSession(timeout=timeout, headers=self.headers) as http,
                http.request(method, f"{self.base}{path}", data=body, ssl=self.tls or True) as answer,
            ):
                if answer.status == 404:
                    return None
                found = await answer.json(content_type=None)
        except (aiohttp.ClientError, TimeoutError, ValueError) as error:
            raise NoAnswerError(f"{self.base} does not answer: {_why(error)}{self._hint}") from error
        if not isinstance(found, dict) or answer.status != 200:
            text = "; ".join([found.get("error", ""), *found.get("problems", ())]) if isinstance(found, dict) else ""
            told = f"{self.base} answers {answer.status} {text}".rstrip()
            raise NoAnswerError(told, why=text, status=answer.status)
        return found


def _why(error: Exception) -> str:
    """In words; aiohttp's own name the object that holds our certificates."""
    if isinstance(error, aiohttp.ClientConnectorCertificateError):
        return str(error.certificate_error)
    if isinstance(error, aiohttp.ClientConnectorError):
        return error.os_error.strerror or str(error.os_error)
    return str(error) or type(error).__name__


@contextlib.asynccontextmanager
async def connect(session: Session, *, url: str | None, namespace: str) -> AsyncIterator[Link]:
    """A link to the scheduler at `url`, or to its pod in `namespace`. Never fails: see `Link.problem`."""
    headers, tls = await _identity(session)
    if url:
        yield _given(url.strip(), headers, tls)
        return
    options = session.options
    tunnel = open_tunnel(session.client, namespace, kubeconfig=options.kubeconfig, context=options.context)
    async with contextlib.AsyncExitStack() as stack:
        try:
            port = await stack.enter_async_context(tunnel)
        except NoTunnelError as error:
            yield Link(problem=str(error))
            return
        yield Link(f"https://127.0.0.1:{port}", headers, tls=tls)


def _given(url: str, headers: dict[str, str], tls: ssl.SSLContext) -> Link:
    """A link to the address that the user names. The token goes to this machine, or encrypted to a server that proves its name."""
    parts = urlsplit(url)
    if not _local(parts.hostname or ""):
        _verify(tls)
        if parts.scheme != "https":
            return Link(problem=f"{url} is not encrypted: your token is sent to https:// and to this machine only")
    return Link(url.rstrip("/"), headers, tls=tls)


async def _identity(session: Session) -> tuple[dict[str, str], ssl.SSLContext]:
    """The user's token, and a context that presents the user's certificate and believes any scheduler.

    A scheduler makes its certificate at its start, so it cannot be verified. kubectl's tunnel ends in the pod the API
    server named, which is what a certificate would prove; for other addresses see `_verify`.
    """
    own = endpoint(session.options)  # a context of our own: that of the API server's connection must go on verifying
    if own.credentials.due:
        await own.credentials.refresh()
    tls = own.tls or ssl.create_default_context()
    tls.check_hostname = False
    tls.verify_mode = ssl.CERT_NONE
    return {"Authorization": own.credentials.authorization} if own.credentials.authorization else {}, tls


def _verify(tls: ssl.SSLContext) -> None:
    """Believe the machine's and the cluster's authorities only."""
    tls.load_default_certs()
    tls.verify_mode = ssl.CERT_REQUIRED
    tls.check_hostname = True


def _local(host: str) -> bool:
    """Whether the address is on this machine: a port-forward of the user's own. A name that begins with 127. is any name."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
