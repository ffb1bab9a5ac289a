"""`robotapp-console`: reads flags, serves until stopped."""

import asyncio
import contextlib
import logging
import os
import secrets
import signal
import socket
import ssl
import sys
from collections.abc import AsyncIterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from robotapp_api.model.names import SYSTEM_NAMESPACE
from robotapp_api.values.arguments import is_name
from robotapp_client import ApiClient, ClientError, Endpoint, LoginError, load
from robotapp_client.serving import logs
from robotapp_client.serving.port import Port
from robotapp_client.serving.tls import TlsPort, loaded
from robotapp_client.tools.scheduler_tunnel import open_tunnel
from robotapp_client.transport.kubeconfig import default_kubeconfigs, follow_authority
from robotapp_client.transport.proxy import find_proxy
from robotapp_console.cluster.config_store import Place
from robotapp_console.cluster.informer_sets import IDLE_S, InformerSets
from robotapp_console.cluster.scheduler_port import SchedulerPort
from robotapp_console.opening import OpeningPage
from robotapp_console.settings import TRUSTED_ROOT, Settings, parse
from robotapp_console.web.console import LOCAL, Console
from robotapp_console.web.server import serve
from robotapp_console.web.sessions import LocalDoor, Seal

log = logging.getLogger(__name__)
LOOPBACK: Final = "127.0.0.1"
_LEAST_KEY: Final = 32
_CERTIFICATE_POLL_S: Final = 30.0


def main(argv: Sequence[str] | None = None) -> int:
    """0 after a clean stop, 2 when flags, files, credentials or the port cannot be used."""
    settings = parse(argv)
    logs.set_up(settings.log_format, settings.log_level)
    logging.getLogger("robotapp_client.informer").setLevel(logging.ERROR)  # pages show what cannot be read, and to whom
    try:
        asyncio.run(_serve_local(settings) if settings.local else _serve_cluster(settings))
    except LoginError as error:
        print(f"robotapp-console: {error}", file=sys.stderr)  # noqa: T201 - for the person who started us
        return 2
    return 0


async def _serve_local(settings: Settings) -> None:
    """Serves the kubeconfig's user on 127.0.0.1 until Ctrl-C."""
    files = [settings.kubeconfig] if settings.kubeconfig else default_kubeconfigs()
    api = load(files or None, settings.context)
    listener = _open_port(LOOPBACK, settings.port)
    port = listener.getsockname()[1]
    door = LocalDoor()
    console = Console(
        api,
        Seal(secrets.token_bytes(_LEAST_KEY)),
        door=door,
        hosts=frozenset({f"{LOOPBACK}:{port}", f"localhost:{port}"}),
        cookie=f"robotapp-console-{port}",
        informers=InformerSets(idle_s=float("inf")),
        config_place=find_config_place(settings),
        # A context of its own: that of the API server's connection goes on verifying.
        scheduler=open_scheduler(settings, load(files or None, settings.context).tls, api),
    )

    def print_address(words: str) -> None:
        print(f"{words} http://{LOOPBACK}:{port}{door.path}", flush=True)  # noqa: T201 - what was asked for

    page = OpeningPage()

    def print_next() -> None:
        page.remove()
        print_address("For another browser, once:")

    console.on_opened = print_next
    try:
        console.local_user = await (await console.informers.get(LOCAL, api)).fetch_user()
    except ClientError as error:
        listener.close()
        await console.informers.close()
        raise LoginError(f"the API server {api.server} cannot be used: {error}") from error
    port_server = await serve(console, listener)
    print(f"The console of {api.server}, as {console.local_user or 'you'}. Ctrl-C ends it.", flush=True)  # noqa: T201
    print_address("Open, once:")
    try:
        if settings.browser:
            page.show(f"http://{LOOPBACK}:{port}{door.path}")
        await _wait_for_end(port_server)
    finally:
        page.remove()


async def _serve_cluster(settings: Settings) -> None:
    """Serves everybody who has a token of the cluster."""
    console = Console(
        _find_api_server(settings),
        Seal(_read_cookie_key(settings.cookie_key)),
        token_header=settings.token_header,
        behind_proxy=settings.plain_http,
        hosts=frozenset(settings.hosts),
        informers=InformerSets(idle_s=IDLE_S),
        config_place=find_config_place(settings),
        scheduler=open_scheduler(settings, None),
    )
    tls = None if settings.plain_http else await loaded(TlsPort(settings.certificate, settings.key))
    listener = _open_port(settings.listen, settings.port)
    port = await serve(console, listener, tls=tls.current if tls else None)
    log.info("serving on %s port %d, API server %s", settings.listen, port.number, console.api.server)
    certificate_task = asyncio.create_task(_follow_certificate(tls)) if tls and settings.certificate else None
    await _wait_for_end(port)
    if certificate_task is not None:
        certificate_task.cancel()


def find_config_place(settings: Settings) -> Place:
    """Returns where the scheduler's configuration is. Raises LoginError for what is no name."""
    if not settings.scheduler_config:
        return Place()
    namespace, slash, name = settings.scheduler_config.rpartition("/")
    if not is_name(name) or (slash and not is_name(namespace)):
        raise LoginError(f"--scheduler-config {settings.scheduler_config}: write [NAMESPACE/]NAME of a ConfigMap")
    return Place(namespace or SYSTEM_NAMESPACE, name)


def open_scheduler(settings: Settings, tls: ssl.SSLContext | None, api: Endpoint | None = None) -> SchedulerPort:
    """Returns the way to the scheduler's port: its address, or for the kubeconfig's user `api` a tunnel to its pod.

    Raises LoginError for an address to which no token may be sent.

    A scheduler on this machine, such as one behind a port-forward, makes its own certificate, which cannot be verified.
    """
    parts = urlsplit(settings.scheduler_url)
    context = tls or ssl.create_default_context()
    if not settings.scheduler_url:
        _believe_any(context)
        return SchedulerPort(tls=context, tunnel=partial(_open_tunnel, settings, api) if api is not None else None)
    if parts.scheme != "https" or not parts.hostname:
        raise LoginError(f"--scheduler-url {settings.scheduler_url}: tokens are sent over https:// alone")
    if settings.scheduler_unverified or parts.hostname in ("localhost", LOOPBACK, "::1"):
        _believe_any(context)
    else:
        try:
            context.load_default_certs()
            if settings.scheduler_authority is not None:
                context.load_verify_locations(cafile=str(settings.scheduler_authority))
        except (OSError, ssl.SSLError) as error:
            raise LoginError(f"--scheduler-ca {settings.scheduler_authority} cannot be loaded: {error}") from error
    return SchedulerPort(settings.scheduler_url, tls=context)


def _believe_any(context: ssl.SSLContext) -> None:
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE


@contextlib.asynccontextmanager
async def _open_tunnel(settings: Settings, api: Endpoint) -> AsyncIterator[int]:
    """Gives a port of this machine that leads to the scheduler's pod."""
    namespace = find_config_place(settings).namespace
    async with (
        ApiClient(api, user_agent="robotapp-console", max_connections=1) as client,
        open_tunnel(client, namespace, kubeconfig=settings.kubeconfig, context=settings.context) as port,
    ):
        yield port


def _open_port(host: str, port: int) -> socket.socket:
    """Returns an open port; 0 takes a free one. Raises LoginError, because the user must do something about it."""
    try:
        return socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        raise LoginError(f"{host} port {port}: {error.strerror or error}; --port names another one") from error


async def _wait_for_end(port: Port) -> None:
    ending = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGINT, signal.SIGTERM):
        with contextlib.suppress(NotImplementedError):  # Windows
            loop.add_signal_handler(name, ending.set)
    await ending.wait()
    await port.close()


async def _follow_certificate(tls: TlsPort) -> None:
    """Takes a renewed certificate in; the old one stays while the new one cannot be used."""
    while True:
        await asyncio.sleep(_CERTIFICATE_POLL_S)
        try:
            tls.load()
        except LoginError as error:
            log.warning("the certificate in use stays: %s", error)


def _find_api_server(settings: Settings) -> Endpoint:
    """Returns the API server without credentials: the console has none. Raises LoginError."""
    server = settings.api_server.rstrip("/")
    if not server:
        host, port = os.environ.get("KUBERNETES_SERVICE_HOST", ""), os.environ.get("KUBERNETES_SERVICE_PORT", "443")
        if not host:
            raise LoginError("no API server: not running in a pod (use --api-server URL, or --local with a kubeconfig)")
        server = f"https://[{host}]:{port}" if ":" in host else f"https://{host}:{port}"
    if not server.startswith("https://"):
        raise LoginError(f"--api-server {server}: tokens are sent over https:// alone")
    authority = settings.certificate_authority or TRUSTED_ROOT
    return Endpoint(server, follow_authority(authority), proxy=find_proxy(server, os.environ))


def _read_cookie_key(file: Path | None) -> bytes:
    """Returns the secret of the cookies: the file's, or a random one, with which sessions end with the process."""
    if file is None:
        return secrets.token_bytes(_LEAST_KEY)
    try:
        key = file.read_bytes().strip()
    except OSError as error:
        raise LoginError(f"cannot read the cookie key {file}: {error.strerror}") from error
    if len(key) < _LEAST_KEY:
        raise LoginError(f"the cookie key {file} has {len(key)} bytes, at least {_LEAST_KEY} are needed")
    return key
