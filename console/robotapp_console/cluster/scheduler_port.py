"""The scheduler's own port: asks it what another configuration would change, with the credentials of the user who looks."""

import ssl
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import quote

import aiohttp
import msgspec

from robotapp_client import ClientError, Endpoint
from robotapp_client.tools.scheduler_tunnel import NoTunnelError
from robotapp_console.views.texts import clean

PATIENCE_S: Final = 30.0
MOST_ANSWER: Final = 8 << 20
"""Bytes; the scheduler sends no more."""
Tunnel = Callable[[], AbstractAsyncContextManager[int]]
NO_ADDRESS: Final = "The console does not know where the scheduler's port is: start it with --scheduler-url. The chart does so where scheduler.enabled is true."


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
        return await self._post(endpoint, f"/what-if?namespace={quote(namespace)}", body)

    async def _post(self, endpoint: Endpoint, path: str, body: bytes) -> dict[str, Any]:
        if self.url:
            return await self._post_to(self.url, endpoint, path, body)
        if self._tunnel is None:
            raise SchedulerPortError(NO_ADDRESS)
        try:
            async with self._tunnel() as port:
                return await self._post_to(f"https://127.0.0.1:{port}", endpoint, path, body)
        except (NoTunnelError, ClientError) as error:
            raise SchedulerPortError(f"There is no way to the scheduler: {clean(str(error))}.") from error

    async def _post_to(self, url: str, endpoint: Endpoint, path: str, body: bytes) -> dict[str, Any]:
        headers = await _authorize(endpoint)
        timeout = aiohttp.ClientTimeout(total=PATIENCE_S)
        try:
            async with (
                aiohttp.ClientSession(timeout=timeout, headers=headers) as http,
                http.post(url + path, data=body, ssl=self._tls or True, allow_redirects=False) as response,
            ):
                content = await response.content.read(MOST_ANSWER + 1)
                while not response.content.at_eof() and len(content) <= MOST_ANSWER:
                    content += await response.content.read(MOST_ANSWER + 1)
        except (aiohttp.ClientError, TimeoutError) as error:
            reason = str(error) or type(error).__name__
            raise SchedulerPortError(f"The scheduler at {url} does not answer: {clean(reason)}.") from error
        return _read_answer(response.status, content)


async def _authorize(endpoint: Endpoint) -> dict[str, str]:
    try:
        if endpoint.credentials.due:
            await endpoint.credentials.refresh()
    except ClientError as error:
        raise SchedulerPortError(clean(str(error))) from error
    token = endpoint.credentials.authorization
    return {"Authorization": token} if token else {}


def _read_answer(status: int, content: bytes) -> dict[str, Any]:
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
        raise SchedulerPortError("The scheduler knows no such question: it is older than the console.")
    if status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
        raise SchedulerPortError(
            f"The scheduler refuses: {reason}. A replay takes a ClusterRoleBinding of robotapp-cluster-viewer."
        )
    raise SchedulerPortError(f"The scheduler answers {status}: {reason}.")
