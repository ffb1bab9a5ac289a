"""The port's process: TLS, authorisation and limits; it forwards only authorised requests to the process that places pods.

`python -m robotapp_scheduler.port.server_process SETTINGS`, started by the scheduler, ends with it.
"""

import asyncio
import contextlib
import logging
import os
import signal
import socket
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec

from robotapp_api.model.names import SCHEDULER_MANAGER
from robotapp_client.api.client import ApiClient
from robotapp_client.serving import logs
from robotapp_client.serving.access import Access, Caller, Gatekeeper
from robotapp_client.serving.port import Limits, serve_listener
from robotapp_client.serving.tls import TlsPort, loaded
from robotapp_client.transport.errors import LoginError, Unreachable
from robotapp_client.transport.kubeconfig import load as login
from robotapp_scheduler.port.endpoints import AllowAll, Endpoints, Gate, application
from robotapp_scheduler.port.forked_worker import end_with_parent
from robotapp_scheduler.port.frames import Request, Settings
from robotapp_scheduler.port.remote import Remote
from robotapp_scheduler.port.simulate import Simulator
from robotapp_scheduler.shell.planner.container_memory import measure_simulation_share, read_limit

log = logging.getLogger(__name__)

REVIEWS: Final = 4
"""Connections for questions about callers."""
REVIEW_S: Final = 5.0
NICE: Final = 5
LIMITS: Final = Limits(connections=128, answer_s=90.0)
"""A simulation may take a minute, its upload included."""


class UnavailableGate:
    """The gate while the API server cannot be reached to authenticate callers."""

    def __init__(self, why: str) -> None:
        self._why = why

    async def access(self, _caller: Caller, _namespace: str) -> Access:
        raise Unreachable(self._why, maybe_applied=False)

    async def path(self, _caller: Caller, _verb: str, _path: str) -> Access:
        raise Unreachable(self._why, maybe_applied=False)

    def user_of(self, _caller: Caller) -> str:
        return ""


async def run(settings: Settings) -> None:
    """Serve until the scheduler is gone."""
    reader, writer = await asyncio.open_unix_connection(sock=socket.socket(fileno=settings.handler))
    remote = Remote(reader, writer)
    talking = asyncio.create_task(remote.run())
    listener = socket.socket(fileno=settings.listener)
    tls = await loaded(TlsPort(_path(settings.tls_certificate), _path(settings.tls_key)))

    async def simulation_config() -> Mapping[str, Any]:
        found: Mapping[str, Any] = msgspec.json.decode((await remote.request(Request("simulation-config"))).body)
        return found

    async with contextlib.AsyncExitStack() as stack:
        gate: Gate = AllowAll()
        try:
            endpoint = await asyncio.to_thread(login, _path(settings.kubeconfig))
        except LoginError as error:
            log.warning("callers cannot be authenticated, the API server is not reachable: %s", error)
            gate = gate if settings.insecure else UnavailableGate(str(error))
        else:
            client = ApiClient(
                endpoint, user_agent=f"{SCHEDULER_MANAGER}-port", max_connections=REVIEWS, timeout_s=REVIEW_S
            )
            await stack.enter_async_context(client)
            gate = gate if settings.insecure else Gatekeeper(client)
            following = asyncio.create_task(tls.run(client))
            stack.callback(following.cancel)
        simulator = Simulator(simulation_config, share=partial(measure_simulation_share, read_limit(), os.getppid()))
        endpoints = Endpoints(gate=gate, scheduler=remote, simulator=simulator)
        port = await serve_listener(application(remote, endpoints), listener, tls=tls.current, limits=LIMITS)
        stack.push_async_callback(port.close)
        await talking


def main() -> None:
    end_with_parent()  # else a killed scheduler's port would be taken for a while
    for number in (signal.SIGINT, signal.SIGTERM):  # they are meant for the scheduler
        signal.signal(number, signal.SIG_IGN)
    os.nice(NICE)
    settings = msgspec.json.decode(sys.argv[1], type=Settings)
    logs.set_up(settings.log_format, settings.log_level)
    with contextlib.suppress(ImportError):
        import uvloop

        asyncio.set_event_loop_policy(uvloop.EventLoopPolicy())
    asyncio.run(run(settings))


def _path(text: str | None) -> Path | None:
    return Path(text) if text else None


if __name__ == "__main__":
    main()
