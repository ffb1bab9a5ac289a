"""Asking the scheduler why: by a given URL, or through kubectl port-forward to its pod.

The API server's own pod proxy would do, were it not that it drops the Authorization header the scheduler asks for.
"""

import asyncio
import contextlib
import ipaddress
import re
import ssl
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Final
from urllib.parse import urlsplit

import aiohttp

from robotapp_cli.reading.fields import Json, meta, status
from robotapp_cli.reading.session import Session, endpoint
from robotapp_client.api.resources import LEASES, PODS
from robotapp_client.transport.errors import ApiError

_SELECTOR: Final = "app.kubernetes.io/component=scheduler"
_RELEASE: Final = "app.kubernetes.io/instance"
_LEASE: Final = "robotapp-scheduler"
_PORT: Final = 10259
_PATIENCE_S: Final = 5.0
_LONG_PATIENCE_S: Final = 70.0
"""For /simulate, which may work for a minute, and /what-if."""
_LISTENING: Final = re.compile(r"127\.0\.0\.1:(\d+)")


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
    try:
        pod, port = await _scheduler_pod(session, namespace)
        process, local = await _forward(session, namespace, pod=pod, port=port)
    except NoAnswerError as error:
        yield Link(problem=str(error))
        return
    try:
        yield Link(f"https://127.0.0.1:{local}", headers, tls=tls)
    finally:
        with contextlib.suppress(ProcessLookupError):  # the tunnel ends by itself when the pod does
            process.terminate()
        await process.wait()


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


async def _scheduler_pod(session: Session, namespace: str) -> tuple[str, int]:
    """The leading scheduler pod and its port. The user's token goes there, so it must be the one it says it is."""
    try:
        pods = (await session.client.list(PODS, namespace=namespace, label_selector=_SELECTOR)).items
    except ApiError as error:
        raise NoAnswerError(f"{error.message}{_way(error.message)}") from error
    running = [pod for pod in pods if status(pod).get("phase") == "Running"]
    if not running:
        raise NoAnswerError(f"no scheduler pod runs in namespace {namespace}")
    pod = _certain(running, await _leader(session, namespace), namespace=namespace)
    ports = [port for container in pod["spec"]["containers"] for port in container.get("ports") or []]
    health = next((port["containerPort"] for port in ports if port.get("name") == "health"), _PORT)
    return meta(pod)["name"], int(health)


def _certain(running: list[Json], leader: str, *, namespace: str) -> Json:
    """The pod that holds the Lease, which only schedulers write; a label every user of the namespace may set.

    Who may not read the Lease gets any pod of the one release there is. Raises `NoAnswerError`.
    """
    cure = "name one with --scheduler-url"
    if leader:
        found = next((pod for pod in running if meta(pod)["name"] == leader), None)
        if found is None:
            held = f"Lease {namespace}/{_LEASE} is held by {leader}, which is no running scheduler pod"
            raise NoAnswerError(f"{held} of this namespace: your token is not sent to another; {cure}")
        return found
    releases = {(meta(pod).get("labels") or {}).get(_RELEASE, "") for pod in running}
    if releases == {""} or len(releases) > 1:
        names = ", ".join(sorted(meta(pod)["name"] for pod in running))
        raise NoAnswerError(
            f"which of {names} in namespace {namespace} is the scheduler is not certain (Lease {_LEASE} cannot be read or has "
            f"no holder, and they are not of one release, label {_RELEASE}): your token is sent to none; {cure}"
        )
    return running[0]


async def _leader(session: Session, namespace: str) -> str:
    try:
        lease = await session.client.get(LEASES, _LEASE, namespace=namespace)
    except ApiError:  # users seldom may read Leases
        return ""
    return str(lease.get("spec", {}).get("holderIdentity") or "")


async def _forward(session: Session, namespace: str, *, pod: str, port: int) -> tuple[asyncio.subprocess.Process, int]:
    options = session.options
    command = ["kubectl", "port-forward", "-n", namespace, f"pod/{pod}", f":{port}"]
    command += ["--context", options.context] if options.context else []
    command += ["--kubeconfig", str(options.kubeconfig)] if options.kubeconfig else []
    pipe = asyncio.subprocess.PIPE
    try:
        process = await asyncio.create_subprocess_exec(
            *command, stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe
        )
    except OSError as error:
        raise NoAnswerError(f"kubectl port-forward cannot be started: {error.strerror}") from error
    assert process.stdout is not None  # noqa: S101 - asked for with a pipe
    try:
        line = (await asyncio.wait_for(process.stdout.readline(), _PATIENCE_S)).decode()
    except TimeoutError:
        line = ""
    if found := _LISTENING.search(line):
        return process, int(found[1])
    if process.returncode is None:
        process.terminate()
    _, complaint = await process.communicate()
    text = complaint.decode(errors="replace").strip().rpartition("\n")[2]
    raise NoAnswerError(f"kubectl port-forward to {pod} failed: {text or 'no answer'}{_way(text)}")


def _way(refusal: str) -> str:
    """What to ask for where the API server refuses a way to the scheduler."""
    if " is forbidden" not in refusal:
        return ""
    return "; ask for Role robotapp-ask-scheduler of docs/cli.md in that namespace, or name the scheduler with --scheduler-url"
