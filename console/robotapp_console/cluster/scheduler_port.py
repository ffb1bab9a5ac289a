"""The scheduler's own port: asks it about decisions and other configurations, with the credentials of the user who looks."""

import asyncio
import ssl
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import aiohttp
import msgspec

from robotapp_client import ApiClient, ClientError, Endpoint
from robotapp_client.tools.scheduler_tunnel import NoTunnelError, Tunnel, open_tunnel
from robotapp_console.views.texts import clean

PATIENCE_S: Final = 30.0
TUNNEL_S: Final = 10.0
"""For each request that finds the scheduler's pod."""
MOST_ANSWER: Final = 8 << 20
"""Bytes; the scheduler sends no more."""

NO_ADDRESS: Final = "The console does not know where the scheduler's port is: start it with --scheduler-url (chart: console.scheduler.url)."


class SchedulerPortError(Exception):
    """There is no answer; the text says why and what helps."""


class TunnelKeeper:
    """Keeps a tunnel to the scheduler's pod for the kubeconfig's user: opened when it is needed, and anew when it has ended."""

    def __init__(self, namespace: str, *, context: str | None, kubeconfig: Path | None) -> None:
        self._namespace = namespace
        self._context = context
        self._kubeconfig = kubeconfig
        self._tunnel: Tunnel | None = None
        self._lock = asyncio.Lock()

    def __repr__(self) -> str:
        return f"<TunnelKeeper {self._tunnel.url if self._tunnel else 'without a tunnel'}>"

    async def find_url(self, endpoint: Endpoint) -> str:
        """Returns the tunnel's address. Raises SchedulerPortError."""
        async with self._lock:
            if self._tunnel is None or not self._tunnel.is_open:
                try:
                    async with ApiClient(endpoint, user_agent="robotapp-console", timeout_s=TUNNEL_S) as client:
                        self._tunnel = await open_tunnel(
                            client, self._namespace, context=self._context, kubeconfig=self._kubeconfig
                        )
                except (NoTunnelError, ClientError) as error:
                    raise SchedulerPortError(f"There is no way to the scheduler: {clean(str(error))}.") from error
            return self._tunnel.url

    async def close(self) -> None:
        async with self._lock:
            if self._tunnel is not None:
                await self._tunnel.close()
                self._tunnel = None


class SchedulerPort:
    """One scheduler by its address, or through a tunnel. Without both every question is answered with what to do about it."""

    def __init__(self, url: str = "", *, tls: ssl.SSLContext | None = None, keeper: TunnelKeeper | None = None) -> None:
        self.url = url.rstrip("/")
        self._tls = tls
        self._keeper = keeper

    def __repr__(self) -> str:
        return f"<SchedulerPort {self.url or self._keeper or 'without an address'}>"

    async def close(self) -> None:
        """Ends the tunnel."""
        if self._keeper is not None:
            await self._keeper.close()

    async def replay(self, endpoint: Endpoint, config: dict[str, Any], count: int, *, namespace: str) -> dict[str, Any]:
        """Returns the scheduler's answer: which of the latest placements would sit elsewhere. Raises SchedulerPortError."""
        body = msgspec.json.encode({"config": config, "replay": count})
        status, content = await self._ask(endpoint, "POST", f"/what-if?namespace={quote(namespace)}", body)
        return _read_answer(status, content, cure="A replay takes a ClusterRoleBinding of robotapp-cluster-viewer.")

    async def explain(self, endpoint: Endpoint, namespace: str, pod: str) -> dict[str, Any] | None:
        """Returns the record of the decision about a pod, None when there is none. Raises SchedulerPortError."""
        status, content = await self._ask(endpoint, "GET", f"/explain/{quote(namespace)}/{quote(pod)}")
        if status == HTTPStatus.NOT_FOUND:
            return None
        return _read_answer(
            status, content, cure="It takes the right to get pods there, and to get nodes for their names."
        )

    async def _ask(self, endpoint: Endpoint, method: str, path: str, body: bytes | None = None) -> tuple[int, bytes]:
        """Returns the status and the body of the answer, of which no more is read than may be sent."""
        url = self.url or (await self._keeper.find_url(endpoint) if self._keeper else "")
        if not url:
            raise SchedulerPortError(NO_ADDRESS)
        headers = await _authorize(endpoint)
        timeout = aiohttp.ClientTimeout(total=PATIENCE_S)
        try:
            async with (
                aiohttp.ClientSession(timeout=timeout, headers=headers) as http,
                http.request(method, url + path, data=body, ssl=self._tls or True, allow_redirects=False) as response,
            ):
                content = await response.content.read(MOST_ANSWER + 1)
                while not response.content.at_eof() and len(content) <= MOST_ANSWER:
                    content += await response.content.read(MOST_ANSWER + 1)
        except (aiohttp.ClientError, TimeoutError) as error:
            await self.close()  # the pod may be gone: the next question opens a tunnel to its successor
            reason = str(error) or type(error).__name__
            raise SchedulerPortError(f"The scheduler at {url} does not answer: {clean(reason)}.") from error
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
        raise SchedulerPortError("The scheduler knows no such question: it is older than the console.")
    if status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
        raise SchedulerPortError(f"The scheduler refuses: {reason}. {cure}")
    raise SchedulerPortError(f"The scheduler answers {status}: {reason}.")
