"""The scheduler's own port: asks it about decisions and other configurations, with the credentials of the user who looks."""

import asyncio
import contextlib
import ssl
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import quote, urlsplit

import aiohttp
import msgspec

from robotapp_client import ClientError, Endpoint
from robotapp_client.tools.scheduler_tunnel import NoTunnelError
from robotapp_console.views.texts import clean

PATIENCE_S: Final = 30.0
AT_ONCE: Final = 8
"""Questions about pods at a time."""
MOST_ANSWER: Final = 8 << 20
"""Bytes; the scheduler sends no more."""
Tunnel = Callable[[], AbstractAsyncContextManager[int]]
NO_ADDRESS: Final = "The console has no address of the scheduler's port: start it with --scheduler-url. The chart does so where scheduler.enabled is true."


class SchedulerPortError(Exception):
    """There is no answer; the text says why and what helps."""


class SchedulerPort:
    """One scheduler by its address, or through a tunnel that is opened for each question and gives a port of this machine.

    Without either every question is answered with what to do about it.
    """

    def __init__(self, url: str = "", *, tls: ssl.SSLContext | None = None, tunnel: Tunnel | None = None) -> None:
        self.url = url.rstrip("/")
        self._tls = tls
        self._tunnel = tunnel

    def __repr__(self) -> str:
        return f"<SchedulerPort {self.url or 'without an address'}>"

    async def replay(self, endpoint: Endpoint, config: dict[str, Any], count: int, *, namespace: str) -> dict[str, Any]:
        """Returns the scheduler's answer: which of the latest placements would sit elsewhere. Raises SchedulerPortError."""
        body = msgspec.json.encode({"config": config, "replay": count})
        async with self._reach() as url:
            status, content = await self._ask(endpoint, "POST", f"{url}/what-if?namespace={quote(namespace)}", body)
        return _read_answer(status, content, cure="A replay takes a ClusterRoleBinding of robotapp-cluster-viewer.")

    async def explain(
        self, endpoint: Endpoint, namespace: str, pods: Sequence[str]
    ) -> tuple[dict[str, dict[str, Any]], str]:
        """Returns the records of the decisions about pods, by name, and why there are no others: after a failure no more is asked."""
        records: dict[str, dict[str, Any]] = {}
        problems: list[str] = []
        limit = asyncio.Semaphore(AT_ONCE)

        async def fetch(url: str, pod: str) -> None:
            async with limit:
                if problems:
                    return
                try:
                    record = await self._explain_pod(endpoint, f"{url}/explain/{quote(namespace)}/{quote(pod)}")
                except SchedulerPortError as error:
                    problems.append(str(error))
                    return
                if record is not None:
                    records[pod] = record

        try:
            async with self._reach() as url, asyncio.TaskGroup() as tasks:
                for pod in pods:
                    tasks.create_task(fetch(url, pod))
        except SchedulerPortError as error:
            problems.append(str(error))
        return records, problems[0] if problems else ""

    async def _explain_pod(self, endpoint: Endpoint, url: str) -> dict[str, Any] | None:
        status, content = await self._ask(endpoint, "GET", url)
        if status == HTTPStatus.NOT_FOUND:
            return None
        cure = "It takes the right to get pods there, and to get nodes for their names."
        return _read_answer(status, content, cure=cure)

    @contextlib.asynccontextmanager
    async def _reach(self) -> AsyncIterator[str]:
        """Gives the scheduler's address; a tunnel stands as long as it is used. Raises SchedulerPortError."""
        if self.url:
            yield self.url
            return
        if self._tunnel is None:
            raise SchedulerPortError(NO_ADDRESS)
        async with contextlib.AsyncExitStack() as stack:
            try:
                port = await stack.enter_async_context(self._tunnel())
            except (NoTunnelError, ClientError) as error:
                raise SchedulerPortError(f"There is no way to the scheduler: {clean(str(error))}.") from error
            yield f"https://127.0.0.1:{port}"

    async def _ask(self, endpoint: Endpoint, method: str, url: str, body: bytes | None = None) -> tuple[int, bytes]:
        """Returns the status and the body of the answer, of which no more is read than may be sent."""
        headers = await _authorize(endpoint)
        timeout = aiohttp.ClientTimeout(total=PATIENCE_S)
        try:
            async with (
                aiohttp.ClientSession(timeout=timeout, headers=headers) as http,
                http.request(method, url, data=body, ssl=self._tls or True, allow_redirects=False) as response,
            ):
                content = await response.content.read(MOST_ANSWER + 1)
                while not response.content.at_eof() and len(content) <= MOST_ANSWER:
                    content += await response.content.read(MOST_ANSWER + 1)
        except (aiohttp.ClientError, TimeoutError) as error:
            reason, address = str(error) or type(error).__name__, urlsplit(url)
            server = f"{address.scheme}://{address.netloc}"
            raise SchedulerPortError(f"The scheduler at {server} does not answer: {clean(reason)}.") from error
        return response.status, content


async def _authorize(endpoint: Endpoint) -> dict[str, str]:
    try:
        if endpoint.credentials.due:
            await endpoint.credentials.refresh()
    except ClientError as error:
        raise SchedulerPortError(clean(str(error))) from error
    token = endpoint.credentials.authorization
    return {"Authorization": token} if token else {}


def _read_answer(status: int, content: bytes, *, cure: str) -> dict[str, Any]:
    try:
        answer = msgspec.json.decode(content, type=dict[str, Any]) if len(content) <= MOST_ANSWER else {}
    except msgspec.MsgspecError:
        answer = {}
    if status == HTTPStatus.OK and answer:
        return answer
    words = [str(answer.get("error", "")), *(str(problem) for problem in answer.get("problems") or ())]
    reason = clean("; ".join(word for word in words if word)) or "no reason was given"
    if status == HTTPStatus.TOO_MANY_REQUESTS:
        raise SchedulerPortError(f"The scheduler is busy with other questions: {reason}. Ask again in some seconds.")
    if status == HTTPStatus.NOT_FOUND:
        raise SchedulerPortError("The scheduler has no such question: it is older than the console.")
    if status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
        raise SchedulerPortError(f"The scheduler refuses: {reason}. {cure}")
    raise SchedulerPortError(f"The scheduler answers {status}: {reason}.")
